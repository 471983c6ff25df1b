// SPDX-License-Identifier: BSD-3-Clause
/** Says what this browser shows, whenever it changes: nothing is sent that nobody sees. */

const PERIOD = 120;             // from one message to the next [ms]

export class Watch {
  /** @param {function} shown f() -> the message, see doc/web_protocol.md */
  constructor(connection, shown) {
    this.connection = connection;
    this.shown = shown;
    this.said = '';
    connection.on('hello', () => this.restart());
    for (const name of ['visibilitychange', 'scroll']) document.addEventListener(name, () => this.changed(), true);
    window.addEventListener('resize', () => this.changed());
  }

  /** The server knows nothing of this browser. */
  restart() {
    this.said = '';
    this.changed();
  }

  /** Something may have changed: say so soon. */
  changed() {
    if (this.timer) return;
    this.timer = setTimeout(() => {
      this.timer = null;
      const text = JSON.stringify(this.shown());
      if (text === this.said || !this.connection.send(JSON.parse(text))) return;
      this.said = text;
    }, this.said ? PERIOD : 0);
  }
}
