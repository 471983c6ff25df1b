// SPDX-License-Identifier: BSD-3-Clause
/** Short messages about what came of something, at the lower edge; they go after a while. */
import {byId, make} from './dom.js';

const SHOWN = 6000;             // [ms]
const MOST = 3;

/** Show a note. @param {boolean} bad whether something failed */
export function note(text, bad = false) {
  const place = byId('notes');
  const line = make('div', {class: bad ? 'note bad' : 'note'}, text);
  place.append(line);
  while (place.children.length > MOST) place.firstChild.remove();
  setTimeout(() => line.remove(), SHOWN);
}

/** Show what came of a request: its text, or why it failed. */
export async function noteResult(what, request) {
  try {
    const answer = await request;
    note(`${what}: ${answer.text || 'done'}`);
    return answer;
  } catch (error) {
    note(`${what}: ${error.message}`, true);
    return null;
  }
}
