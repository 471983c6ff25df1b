// SPDX-License-Identifier: BSD-3-Clause
/** The log of both sides, the newest entry first, from a level on. Entries that come again are known by what they say. */
import {make} from './dom.js';
import {timeOfDay} from './units.js';

const MOST = 300;
const LEVELS = ['debug', 'info', 'warn', 'error', 'fatal'];

export class LogPanel {
  /** @param {HTMLElement} list; @param {HTMLSelectElement} least level that is shown */
  constructor(list, least) {
    this.list = list;
    this.clear();
    least.addEventListener('change', () => this.setLeast(least.value));
    this.setLeast(least.value);
  }

  setLeast(level) {
    this.list.dataset.least = level;
  }

  clear() {
    this.known = new Set();     // of those that are shown
    this.list.replaceChildren();
  }

  /** Add entries, oldest first. */
  add(entries) {
    for (const entry of entries) {
      const key = JSON.stringify(entry);
      if (this.known.has(key)) continue;
      this.known.add(key);
      this.list.prepend(make(
        'li', {'data-key': key, 'data-level': LEVELS.includes(entry.level) ? entry.level : 'info'},
        make('span', {class: 'when'}, timeOfDay(entry.stamp)), make('b', {}, entry.level.toUpperCase()),
        make('span', {class: 'from'}, `${entry.side}${entry.node}`), make('span', {class: 'said'}, entry.text)));
    }
    while (this.list.children.length > MOST) {
      this.known.delete(this.list.lastChild.dataset.key);
      this.list.lastChild.remove();
    }
  }
}
