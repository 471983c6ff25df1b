// SPDX-License-Identifier: BSD-3-Clause
/** Stills of this browser and captures of the desk, to be downloaded. */
import {make} from './dom.js';
import {size, timeOfDay} from './units.js';

const MOST = 30;

/** Add a still: its image, and its numbers. @param {Object} still answer of the server */
export function addStill(list, title, still) {
  list.prepend(make(
    'li', {}, make('span', {}, `${title} ${timeOfDay(Date.now() / 1e3)}`),
    make('a', {href: still.image, download: true}, 'Image'), make('a', {href: still.numbers, download: true}, 'Numbers')));
  while (list.children.length > MOST) list.lastChild.remove();
}

/** List the captures. @param {Array} files newest first */
export function showCaptures(list, files) {
  if (!files.length) {
    list.replaceChildren(make('li', {}, 'none yet'));
    return;
  }
  list.replaceChildren(...files.map((file) => make(
    'li', {}, make('a', {href: file.path, download: true}, file.name),
    make('span', {}, `${size(file.size)}, ${timeOfDay(file.time)}`))));
}
