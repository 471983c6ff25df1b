// SPDX-License-Identifier: BSD-3-Clause
/**
 * Commands from the stick and the keys: what is sent, and when.
 *
 * While somebody drives, a command is sent every 75 ms, with the number of the newest tick: a late one is refused. It
 * holds for 0.25 s on the desk. When the touch ends, the tab is hidden, the window is left, or the device is turned,
 * `halt` is sent, three times in case one is late; when the connection is lost, the desk stops the robot by itself.
 */

const PERIOD = 75, HALTS = 3, HALT_PERIOD = 50;     // [ms]
const REST = {x: 0, y: 0, turn: 0};

export class Driving {
  /**
   * @param {Connection} connection
   * @param {function} changed f({x, y, turn} or null): what is sent now, to be shown
   */
  constructor(connection, changed) {
    this.connection = connection;
    this.changed = changed;
    this.wish = null;           // {x, y, turn}, ratios; null: nobody drives here
    this.allowed = false;
    this.share = 0.5;           // of the robot's full speed
    this.halts = 0;
    document.addEventListener('visibilitychange', () => document.hidden && this.stop());
    for (const name of ['blur', 'pagehide', 'freeze']) window.addEventListener(name, () => this.stop());
    connection.on('close', () => this.stop());
    // a device that is turned moves the stick away from the finger; a bar of the browser changes the height only
    let width = innerWidth;
    window.addEventListener('resize', () => {
      if (innerWidth !== width) this.stop();
      width = innerWidth;
    });
  }

  /** Whether this browser may drive now; where it may not any more, it stops. */
  allow(allowed) {
    this.allowed = allowed;
    if (!allowed) this.stop();
  }

  /** Drive: ratios of the chosen speed. Each call counts as a sign of life of the finger or the key. */
  drive(wish) {
    if (!this.allowed) return;
    const begins = this.wish === null;
    this.wish = wish;
    this.changed(wish);
    if (!begins) return;
    this.halts = 0;
    clearInterval(this.timer);
    this.send();
    this.timer = setInterval(() => this.send(), PERIOD);
  }

  /** Stop, if something drives. */
  stop() {
    if (this.wish === null) return;
    this.wish = null;
    this.changed(null);
    clearInterval(this.timer);
    this.halts = HALTS;
    this.halt();
    this.timer = setInterval(() => this.halt(), HALT_PERIOD);
  }

  send() {
    const {x, y, turn} = this.wish || REST;
    this.connection.send({
      type: 'drive', tick: this.connection.tick, x: x * this.share, y: y * this.share, turn: turn * this.share});
  }

  halt() {
    if (this.halts-- > 0) this.connection.send({type: 'halt'});
    else clearInterval(this.timer);
  }
}
