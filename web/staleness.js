// SPDX-License-Identifier: BSD-3-Clause
/** Turns the page grey while the desk is silent, with the seconds counting: nothing may look live that is not. */
import {byId, setText} from './dom.js';
import {monotonic} from './server_clock.js';

const SILENCE = 1, LOOK = 100;  // [s], [ms]

/** Look for silence from now on. */
export function watchSilence(connection) {
  const opened = monotonic();
  const look = () => {
    const silence = monotonic() - (connection.lastTick ?? opened);
    const stale = connection.lastTick === null || silence >= SILENCE;
    document.body.classList.toggle('stale', stale);
    byId('silence').hidden = !stale;
    if (!stale) return;
    const what = connection.lastTick === null ? 'CONNECTING' : 'NO CONNECTION';
    setText(byId('silence-text'), `${what} ${silence.toFixed(1)} s`);
  };
  setInterval(look, LOOK);
  look();
}
