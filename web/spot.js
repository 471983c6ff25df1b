// SPDX-License-Identifier: BSD-3-Clause
/**
 * A place of an image that was touched, with the value there: it is asked for again while the place is marked.
 *
 * Touching the mark takes it away. With the keyboard: Enter marks the middle, arrows move it, Escape takes it away.
 */
import {make, onPress, setText} from './dom.js';

const AGAIN = 500;              // from one value to the next [ms]
const NEAR = 0.06;              // a touch so near takes the mark away [ratio of the image]
const STEP = 0.05;
const KEYS = {ArrowLeft: [-STEP, 0], ArrowRight: [STEP, 0], ArrowUp: [0, -STEP], ArrowDown: [0, STEP]};

export class Spot {
  /**
   * @param {HTMLElement} picture around the canvas
   * @param {function} value f(x, y), 0..1 from the upper left: the promise of its answer
   */
  constructor(picture, canvas, value) {
    this.canvas = canvas;
    this.value = value;
    this.place = null;
    this.text = make('span', {class: 'spot-text', role: 'status'});
    this.mark = make('div', {class: 'spot', hidden: true}, this.text);
    picture.append(this.mark);
    canvas.tabIndex = 0;
    onPress(canvas, (event) => this.touch(event));
    canvas.addEventListener('keydown', (event) => this.press(event));
  }

  /** Where the image is on its canvas, which may be wider or higher than the image: [left, top, width, height]. */
  box() {
    const {width, height} = this.canvas.getBoundingClientRect();
    const scale = Math.min(width / this.canvas.width, height / this.canvas.height);
    const [w, h] = [this.canvas.width * scale, this.canvas.height * scale];
    return [(width - w) / 2, (height - h) / 2, w, h];
  }

  touch(event) {
    const outer = this.canvas.getBoundingClientRect();
    const [left, top, width, height] = this.box();
    const x = (event.clientX - outer.left - left) / width, y = (event.clientY - outer.top - top) / height;
    if (x < 0 || x > 1 || y < 0 || y > 1) return;
    const near = this.place && Math.hypot(x - this.place[0], y - this.place[1]) < NEAR;
    this.put(near ? null : [x, y]);
  }

  press(event) {
    const step = KEYS[event.key];
    if (event.key === 'Escape') this.put(null);
    else if (event.key === 'Enter') this.put([0.5, 0.5]);
    else if (step && this.place) {
      this.put(this.place.map((value, axis) => Math.min(1, Math.max(0, value + step[axis]))));
      event.preventDefault();
    }
  }

  /** Mark a place [x, y]; null: none. */
  put(place) {
    this.place = place;
    this.mark.hidden = place === null;
    setText(this.text, '...');
    clearTimeout(this.timer);
    if (place) this.look(place);
  }

  async look(place) {
    const [left, top, width, height] = this.box();
    const inner = this.canvas.getBoundingClientRect(), outer = this.mark.parentElement.getBoundingClientRect();
    this.mark.style.left = `${inner.left - outer.left + left + place[0] * width}px`;
    this.mark.style.top = `${inner.top - outer.top + top + place[1] * height}px`;
    this.mark.classList.toggle('right', place[0] > 0.6);
    let text = '-';
    try {
      text = (await this.value(...place)).text || '-';
    } catch {
      // the dash says that the value is unknown
    }
    if (place !== this.place) return;
    setText(this.text, text);
    this.timer = setTimeout(() => this.look(place), AGAIN);
  }
}
