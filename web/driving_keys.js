// SPDX-License-Identifier: BSD-3-Clause
/**
 * Driving by the keys of teleop_keyboard, or the arrows, while the stick has the focus.
 *
 * A key drives for KEY_TIMEOUT from the first press on, which spans the time to its first repetition, and for the
 * shorter REPEAT_TIMEOUT from each repetition on, as in a terminal. Releasing it stops at once. Any other key stops.
 */
import {monotonic} from './server_clock.js';

const KEY_TIMEOUT = 0.7, REPEAT_TIMEOUT = 0.25, LOOK = 50;      // [s], [s], [ms]

/** {key: [forward, to the left, turn to the left]} */
const MOVES = {
  i: [1, 0, 0], o: [1, 0, -1], j: [0, 0, 1], l: [0, 0, -1], u: [1, 0, 1], ',': [-1, 0, 0], '.': [-1, 0, 1], m: [-1, 0, -1],
  I: [1, 0, 0], O: [1, -1, 0], J: [0, 1, 0], L: [0, -1, 0], U: [1, 1, 0], '<': [-1, 0, 0], '>': [-1, -1, 0], M: [-1, 1, 0],
  ArrowUp: [1, 0, 0], ArrowDown: [-1, 0, 0], ArrowLeft: [0, 0, 1], ArrowRight: [0, 0, -1]};

const PASSED_ON = ['Tab', 'Shift', 'Control', 'Alt', 'Meta'];

export class DrivingKeys {
  /**
   * @param {HTMLElement} pad that has the focus
   * @param {Driving} driving
   * @param {{estop, take, release}} actions of the keys s, T and G
   */
  constructor(pad, driving, actions) {
    this.driving = driving;
    this.actions = {s: actions.estop, S: actions.estop, T: actions.take, G: actions.release};
    this.held = new Map();      // code of a key -> its factors
    this.until = null;          // when the keys count as released [s]; null: no key drives
    pad.addEventListener('keydown', (event) => this.down(event));
    pad.addEventListener('keyup', (event) => this.up(event));
    pad.addEventListener('blur', () => this.stop());
    setInterval(() => this.until !== null && monotonic() > this.until && this.stop(), LOOK);
  }

  down(event) {
    if (PASSED_ON.includes(event.key)) return;
    event.preventDefault();
    const factors = event.ctrlKey || event.altKey || event.metaKey ? null : MOVES[event.key];
    if (!factors) {
      this.stop();
      if (this.actions[event.key] && !event.repeat) this.actions[event.key]();
      return;
    }
    // after a stop, by whatever cause, a key that is still held does not drive again
    if (!this.driving.allowed || (event.repeat && (this.driving.wish === null || !this.held.has(event.code)))) {
      this.stop();
      return;
    }
    this.held.set(event.code, factors);
    const until = monotonic() + (event.repeat ? REPEAT_TIMEOUT : KEY_TIMEOUT);
    this.until = event.repeat ? Math.max(this.until, until) : until;
    this.drive();
  }

  up(event) {
    if (!this.held.delete(event.code)) return;
    if (this.held.size && this.driving.wish !== null) this.drive();
    else this.stop();
  }

  /** Drive by all keys that are held together. */
  drive() {
    const sums = [0, 1, 2].map((axis) => [...this.held.values()].reduce((sum, factors) => sum + factors[axis], 0));
    const [x, y, turn] = sums.map((value) => Math.max(-1, Math.min(1, value)));
    this.driving.drive({x, y, turn});
  }

  stop() {
    this.held.clear();
    if (this.until === null) return;
    this.until = null;
    this.driving.stop();
  }
}
