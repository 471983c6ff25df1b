// SPDX-License-Identifier: BSD-3-Clause
/** Which part of the ground is shown: x to the right, y up, in metres of the fixed frame. Screen lengths are pixels. */

export const MIN_SCALE = 0.5, MAX_SCALE = 400;      // [pixel/m]

export class MapCamera {
  constructor() {
    this.x = this.y = 0;        // in the middle of the screen [m]
    this.scale = 25;            // [pixel/m]
    this.width = this.height = 1;
    this.mark = 1;              // by which marks and texts are enlarged, as the page's letters
    this.follows = true;        // whether the robot stays in the middle
  }

  /** The place on the screen of a place on the ground. */
  toScreen(x, y) {
    return [this.width / 2 + (x - this.x) * this.scale, this.height / 2 - (y - this.y) * this.scale];
  }

  /** The place on the ground of a place on the screen. */
  toGround(left, top) {
    return [this.x + (left - this.width / 2) / this.scale, this.y - (top - this.height / 2) / this.scale];
  }

  /** Move the ground by pixels; the robot is no longer followed. */
  pan(right, down) {
    this.follows = false;
    this.x -= right / this.scale;
    this.y += down / this.scale;
  }

  /** Enlarge by a factor around a place on the screen; around the robot, if it is followed. */
  zoom(factor, left = this.width / 2, top = this.height / 2) {
    const [x, y] = this.toGround(left, top);
    this.scale = Math.min(MAX_SCALE, Math.max(MIN_SCALE, this.scale * factor));
    if (this.follows) return;
    this.x = x - (left - this.width / 2) / this.scale;
    this.y = y + (top - this.height / 2) / this.scale;
  }

  /** Show an area [x0, y0, x1, y1] as a whole. */
  fit([x0, y0, x1, y1]) {
    this.follows = false;
    this.x = (x0 + x1) / 2;
    this.y = (y0 + y1) / 2;
    const scale = 0.95 * Math.min(this.width / Math.max(x1 - x0, 1), this.height / Math.max(y1 - y0, 1));
    this.scale = Math.min(MAX_SCALE, Math.max(MIN_SCALE, scale));
  }

  /** The area that is shown: [x0, y0, x1, y1]. */
  get area() {
    const [x0, y1] = this.toGround(0, 0), [x1, y0] = this.toGround(this.width, this.height);
    return [x0, y0, x1, y1];
  }
}
