// SPDX-License-Identifier: BSD-3-Clause
/** Messages that are answered: each has an id, which its answer repeats. */

const ANSWERS = ['done', 'value', 'still', 'captures', 'error'];
const TIMEOUT = 6000;           // [ms]

export class Requests {
  constructor(connection) {
    this.connection = connection;
    this.last = 0;
    this.waiting = new Map();   // id -> {resolve, reject}
    for (const type of ANSWERS) connection.on(type, (message) => this.take(message));
    connection.on('close', () => {
      for (const id of [...this.waiting.keys()]) this.fail(id, 'the connection to the desk was lost');
    });
  }

  /**
   * Ask for something; the promise is that of the answer.
   * @throws {Error} with what is wrong, also where `done` says that it was not done
   */
  ask(message) {
    const id = ++this.last;
    return new Promise((resolve, reject) => {
      this.waiting.set(id, {resolve, reject});
      setTimeout(() => this.fail(id, 'no answer from the desk'), TIMEOUT);
      if (!this.connection.send({...message, id})) this.fail(id, 'no connection to the desk');
    });
  }

  take(answer) {
    const waiting = this.waiting.get(answer.id);
    if (!waiting) return;
    this.waiting.delete(answer.id);
    if (answer.type === 'error' || answer.ok === false) waiting.reject(new Error(answer.text || 'refused'));
    else waiting.resolve(answer);
  }

  fail(id, text) {
    const waiting = this.waiting.get(id);
    if (!waiting) return;
    this.waiting.delete(id);
    waiting.reject(new Error(text));
  }
}
