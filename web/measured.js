// SPDX-License-Identifier: BSD-3-Clause
/**
 * How old images are when their pixels are drawn, for tests and for whoever wants to know: `window.smokebot.measured`.
 *
 * Each entry is {stream, stamp, age, added, drawn}: stamp of the image by the robot's clock, its age when it was drawn,
 * the time since the server sent it, and when that was by the server's clock [s].
 */

const MOST = 1200;              // entries

export const measured = [];

/** Add an entry when the frame that is being drawn has been painted. */
export function measure(stream, meta, clock) {
  requestAnimationFrame(() => setTimeout(() => {      // the first task after the painting
    const drawn = clock.now();
    if (drawn === null || meta.age === null) return;
    const added = drawn - meta.sent;
    measured.push({stream, stamp: meta.stamp, age: meta.age + added, added, drawn});
    if (measured.length > MOST) measured.shift();
  }));
}
