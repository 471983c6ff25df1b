// SPDX-License-Identifier: BSD-3-Clause
/**
 * The server's clock, as far as this browser knows it.
 *
 * A ping is answered with the server's time. The answer was given at some time between sending and receiving, so the
 * offset is known with an uncertainty of half the round trip. The best of the last answers counts. A tick that came has
 * been sent: a clock that is behind it is wrong, as after this device has slept.
 */

const ANSWERS = 20;     // that are compared: about as many seconds

/** This browser's time since the page was opened [s]; it never goes back. */
export const monotonic = () => performance.now() / 1e3;

export class ServerClock {
  constructor() {
    this.answers = [];
    this.offset = null;     // of the server's clock from monotonic() [s]
    this.roundTrip = null;  // of the best answer [s]
  }

  /** Take an answer: sent and received are of monotonic(), time is the server's [s]. */
  take(sent, received, time) {
    this.answers.push({roundTrip: received - sent, offset: time - (sent + received) / 2});
    if (this.answers.length > ANSWERS) this.answers.shift();
    const best = this.answers.reduce((a, b) => (b.roundTrip < a.roundTrip ? b : a));
    this.offset = best.offset;
    this.roundTrip = best.roundTrip;
  }

  /** Take the time at which the server sent something that came at `now`. */
  atLeast(time, now) {
    if (this.offset !== null && now + this.offset >= time) return;
    this.answers = [];
    this.offset = time - now;
    this.roundTrip = null;
  }

  /** The server's time now [s]; null: unknown. */
  now() {
    return this.offset === null ? null : monotonic() + this.offset;
  }
}
