// SPDX-License-Identifier: BSD-3-Clause
/** The parts of the page: on a narrow screen one at a time, on a wide one images and map beside one of the others. */
import {byId, make} from './dom.js';

/** As in page.css: what a screen of this width always shows, and what it shows in place of that. */
const WIDTHS = [
  {query: matchMedia('(min-width: 100rem)'), always: ['images', 'map', 'robots', 'drive'], other: 'status'},
  {query: matchMedia('(min-width: 56rem)'), always: ['images', 'map', 'robots'], other: 'drive'}];

export class Tabs {
  /** @param {Object} titles {name of a part: its title}; @param {function} changed f(name) */
  constructor(titles, changed) {
    this.changed = changed;
    this.buttons = new Map(Object.entries(titles).map(([name, title]) => [name, make(
      'button', {type: 'button', 'data-tab': name, press: () => this.choose(name)}, title)]));
    byId('tabs').replaceChildren(...this.buttons.values());
    for (const {query} of WIDTHS) query.addEventListener('change', () => this.choose(this.chosen));
  }

  /** Show a part. */
  choose(wanted) {
    const width = WIDTHS.find(({query}) => query.matches);
    const name = width && width.always.includes(wanted) ? width.other : wanted;
    document.body.dataset.tab = name;
    for (const [other, button] of this.buttons) button.setAttribute('aria-pressed', String(other === name));
    this.chosen = name;
    this.changed(name);
  }

  /** Show or hide the button of a part. */
  offer(name, offered) {
    this.buttons.get(name).hidden = !offered;
  }
}
