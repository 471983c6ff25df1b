// SPDX-License-Identifier: BSD-3-Clause
/** Fingers, mouse and keys on the map: one finger moves it, two zoom, and in goal mode a drag sets place and heading. */

const WHEEL = 0.0015, STEP = 60, KEY_ZOOM = 1.4;
const LEAST_DRAG = 12;          // shorter ones set no heading [pixel]
const KEYS = {ArrowLeft: [STEP, 0], ArrowRight: [-STEP, 0], ArrowUp: [0, STEP], ArrowDown: [0, -STEP]};

export class MapTouch {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {MapCamera} camera
   * @param {{changed: function, goal: function, usesGoal: function}} actions goal(x, y, yaw or null): a place was chosen
   */
  constructor(canvas, camera, actions) {
    this.canvas = canvas;
    this.camera = camera;
    this.actions = actions;
    this.fingers = new Map();   // id -> [left, top]
    this.begun = null;          // where a goal's drag began, on the screen
    canvas.addEventListener('pointerdown', (event) => this.down(event));
    canvas.addEventListener('pointermove', (event) => this.move(event));
    for (const name of ['pointerup', 'pointercancel', 'lostpointercapture']) {
      canvas.addEventListener(name, (event) => this.up(event));
    }
    canvas.addEventListener('wheel', (event) => {
      event.preventDefault();
      camera.zoom(Math.exp(-event.deltaY * WHEEL), ...this.place(event));
      actions.changed();
    }, {passive: false});
    canvas.addEventListener('keydown', (event) => this.press(event));
  }

  place(event) {
    const box = this.canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  down(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.fingers.set(event.pointerId, this.place(event));
    this.begun = this.actions.usesGoal() && this.fingers.size === 1 ? this.place(event) : null;
    if (this.begun) this.setGoal(this.begun);
  }

  move(event) {
    const former = this.fingers.get(event.pointerId);
    if (!former) return;
    const now = this.place(event);
    if (this.begun) {
      this.setGoal(now);
      return;
    }
    this.fingers.set(event.pointerId, now);
    const others = [...this.fingers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
    if (others.length) {
      const [other] = others;
      const distance = (place) => Math.max(1, Math.hypot(place[0] - other[0], place[1] - other[1]));
      this.camera.zoom(distance(now) / distance(former), (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
      this.camera.pan((now[0] - former[0]) / 2, (now[1] - former[1]) / 2);
    } else {
      this.camera.pan(now[0] - former[0], now[1] - former[1]);
    }
    this.actions.changed();
  }

  up(event) {
    this.fingers.delete(event.pointerId);
    this.begun = null;
  }

  setGoal(end) {
    const [x, y] = this.camera.toGround(...this.begun);
    const [right, down] = [end[0] - this.begun[0], end[1] - this.begun[1]];
    this.actions.goal(x, y, Math.hypot(right, down) < LEAST_DRAG ? null : Math.atan2(-down, right));
  }

  press(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const {camera} = this;
    if (KEYS[event.key]) camera.pan(...KEYS[event.key]);
    else if (event.key === '+' || event.key === '=') camera.zoom(KEY_ZOOM);
    else if (event.key === '-') camera.zoom(1 / KEY_ZOOM);
    else if (event.key === 'Enter' && this.actions.usesGoal()) this.actions.goal(camera.x, camera.y, null);
    else return;
    event.preventDefault();
    this.actions.changed();
  }
}
