// SPDX-License-Identifier: BSD-3-Clause
/**
 * The view of an image stream: the picture in a border that shows its state, with its age, its quality and its scale.
 *
 * The age grows while no image comes, and border and colours change by it: nobody has to say that images are missing.
 */
import {make, setData, setText} from './dom.js';
import {decode} from './frame.js';
import {judge} from './image_state.js';
import {measure} from './measured.js';
import {Scale} from './scale.js';
import {Spot} from './spot.js';
import {duration} from './units.js';

export class ImageView {
  /**
   * @param {Object} stream of `hello`
   * @param {ServerClock} clock
   * @param {{still, capture, enlarge, value}} actions f(name of the stream), value: see Spot
   */
  constructor(stream, clock, actions) {
    this.stream = stream;
    this.clock = clock;
    this.meta = null;
    this.since = null;          // when the first frame of this image was sent, by the server's clock [s]
    this.newest = -1;           // number of the newest frame that was drawn
    this.canvas = make('canvas', {width: 4, height: 3, role: 'img'});
    this.banner = make('div', {class: 'banner'});
    this.picture = make('div', {class: 'picture'}, this.canvas, this.banner);
    this.age = make('span', {class: 'age'});
    this.quality = make('span', {class: 'quality'});
    this.notice = make('strong', {class: 'notice'});
    this.scale = new Scale();
    this.spot = stream.values ? new Spot(this.picture, this.canvas, (x, y) => actions.value(stream.name, x, y)) : null;
    this.captureButton = make('button', {press: () => actions.capture(stream.name), class: 'for-driver'}, 'Original');
    this.larger = make('button', {press: () => actions.enlarge(stream.name), 'aria-pressed': 'false'}, 'Enlarge');
    this.element = make(
      'figure', {class: 'view', 'data-stream': stream.name, 'data-state': 'frozen', 'data-primary': stream.primary},
      this.picture,
      make('figcaption', {class: 'strip'}, make('span', {class: 'name'}, stream.title), this.age, this.quality,
        this.notice, this.scale.element),
      make('div', {class: 'buttons'}, this.larger,
        make('button', {press: () => actions.still(stream.name)}, 'Still'),
        ...(stream.captures ? [this.captureButton] : [])));
    this.update();
  }

  /** Draw a frame, unless a newer one is there. */
  async take(frame) {
    const bitmap = frame.data.length ? await decode(frame.data, 'image/jpeg') : null;
    if (frame.number <= this.newest) return;
    this.newest = frame.number;
    if (!this.meta || this.meta.stamp !== frame.meta.stamp) this.since = frame.meta.sent;
    this.meta = frame.meta;
    if (bitmap) {
      if (this.canvas.width !== bitmap.width || this.canvas.height !== bitmap.height) {
        this.canvas.width = bitmap.width;
        this.canvas.height = bitmap.height;
      }
      this.canvas.getContext('2d', {alpha: false}).drawImage(bitmap, 0, 0);
      bitmap.close();
      measure(this.stream.name, frame.meta, this.clock);
    }
    this.scale.show(frame.meta.scale);
    this.update();
  }

  /** Begin anew, as after a lost connection: frames are counted from 1 again. */
  restart() {
    this.newest = -1;
  }

  /** Show the age of now, and what follows from it. */
  update() {
    const {age, state, old, poor, banner} = judge(this.meta, this.clock.now(), this.since);
    const text = age === null ? '-' : (this.meta.at_least ? '> ' : '') + duration(age);
    setData(this.element, 'state', state);
    setText(this.age, text);
    setText(this.quality, this.meta ? this.meta.quality : '');
    this.age.classList.toggle('bad', old);
    this.quality.classList.toggle('bad', poor);
    setText(this.notice, this.meta ? this.meta.notice : '');
    setText(this.banner, banner && age !== null ? `${banner} ${duration(age)}` : banner);
    const label = `${this.stream.title}: ${state === 'frozen' ? banner : state}`;
    if (this.canvas.getAttribute('aria-label') !== label) this.canvas.setAttribute('aria-label', label);
  }

  /** The picture's width on the screen [device pixel]; 0: it cannot be seen. */
  get width() {
    const shape = this.canvas.width / this.canvas.height;
    const box = this.picture.getBoundingClientRect();
    const onScreen = box.bottom > 0 && box.top < innerHeight && box.width > 0;
    return onScreen ? Math.round(Math.min(box.width, (box.height || box.width) * shape) * devicePixelRatio) : 0;
  }
}
