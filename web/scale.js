// SPDX-License-Identifier: BSD-3-Clause
/** The scale of a palette below an image: its colours from cold to hot, with five numbers and their unit. */
import {make, setText} from './dom.js';

export class Scale {
  constructor() {
    this.colours = make('canvas', {width: 1, height: 1, 'aria-hidden': 'true'});
    this.numbers = make('span', {class: 'numbers'});
    this.unit = make('span', {class: 'unit'});
    this.element = make('span', {class: 'scale', hidden: true},
      make('span', {class: 'marks'}, this.colours, this.numbers), this.unit);
    this.shown = '';
  }

  /** Show a scale of an image's metadata; null: none. */
  show(scale) {
    const key = JSON.stringify(scale || null);
    if (key === this.shown) return;
    this.shown = key;
    this.element.hidden = !scale;
    if (!scale) return;
    this.colours.width = scale.colours.length;
    const context = this.colours.getContext('2d');
    scale.colours.forEach((colour, column) => {
      context.fillStyle = colour;
      context.fillRect(column, 0, 1, 1);
    });
    this.numbers.replaceChildren(...scale.numbers.map((number) => make('span', {}, number)));
    setText(this.unit, scale.unit);
  }
}
