// SPDX-License-Identifier: BSD-3-Clause
/** The stick on the screen: a finger that holds it drives, and that leaves it stops. */

const REST = 0.12;              // so near to the middle it is at rest [ratio]

/** A ratio without the rest in the middle. */
function beyondRest(value) {
  return Math.sign(value) * Math.max(0, Math.abs(value) - REST) / (1 - REST);
}

export class Stick {
  /**
   * @param {HTMLElement} pad in which the finger moves
   * @param {HTMLElement} knob that shows where it is
   * @param {Driving} driving
   */
  constructor(pad, knob, driving) {
    this.pad = pad;
    this.knob = knob;
    this.driving = driving;
    this.finger = null;
    this.sideways = false;      // whether it moves to the side instead of turning
    pad.addEventListener('pointerdown', (event) => this.down(event));
    pad.addEventListener('pointermove', (event) => this.move(event));
    for (const name of ['pointerup', 'pointercancel', 'lostpointercapture']) {
      pad.addEventListener(name, (event) => event.pointerId === this.finger && this.release());
    }
    pad.addEventListener('contextmenu', (event) => event.preventDefault());
  }

  down(event) {
    if (this.finger !== null || event.button > 0 || !this.driving.allowed) return;
    this.finger = event.pointerId;
    this.pad.setPointerCapture(event.pointerId);
    this.move(event);
  }

  move(event) {
    if (event.pointerId !== this.finger) return;
    const box = this.pad.getBoundingClientRect();
    const radius = Math.min(box.width, box.height) / 2 * 0.75;
    let right = (event.clientX - box.left - box.width / 2) / radius;
    let up = -(event.clientY - box.top - box.height / 2) / radius;
    const length = Math.hypot(right, up);
    if (length > 1) [right, up] = [right / length, up / length];
    const left = -beyondRest(right);
    this.driving.drive({x: beyondRest(up), turn: this.sideways ? 0 : left, y: this.sideways ? left : 0});
  }

  release() {
    this.finger = null;
    this.driving.stop();
  }

  /** Show a command; null: at rest. */
  show(wish) {
    const {x, y, turn} = wish || {x: 0, y: 0, turn: 0};
    this.knob.style.transform = `translate(${-(turn + y) * 75}%, ${-x * 75}%)`;
    this.pad.classList.toggle('driving', wish !== null);
    if (wish === null) this.finger = null;
  }
}
