// SPDX-License-Identifier: BSD-3-Clause
/** Whether an image counts as live at any time after it came, as codecs/display/view.py judges it. */

export const FRESH = 'fresh', OLD = 'old', FROZEN = 'frozen';

/**
 * Judge an image.
 * @param {Object} meta of its frame, see doc/web_protocol.md
 * @param {number|null} now the server's clock [s]; null: unknown
 * @param {number|null} since when the first frame of this image was sent, by that clock [s]: a frozen one comes again
 * @returns {{age: number|null, state: string, old: boolean, poor: boolean, banner: string}} age: null before the first
 *   image [s]; old, poor: what is wrong with it; banner: across a frozen image
 */
export function judge(meta, now, since) {
  if (meta === null || meta.age === null) {
    return {age: null, state: FROZEN, old: true, poor: false, banner: 'NO DATA YET'};
  }
  const age = Math.max(0, meta.age) + (now === null ? Infinity : Math.max(0, now - meta.sent));
  const poor = meta.reason.includes('quality');
  const old = age >= meta.old_after;
  if (age >= meta.frozen_after || meta.state === FROZEN) {
    return {age, state: FROZEN, old, poor, banner: now === null || now - since >= meta.old_after ? 'NO DATA' : 'LATE'};
  }
  return {age, state: old || poor || meta.state === OLD ? OLD : FRESH, old, poor, banner: ''};
}
