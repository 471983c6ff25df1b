// SPDX-License-Identifier: BSD-3-Clause
/** What has to be known at any time, as in rviz's overlay (codecs/display/overlay.py): the same words and limits. */
import {make, setData, setText} from './dom.js';
import {duration, milliseconds, percent, short, withUnit} from './units.js';

const GOOD = 'good', ATTENTION = 'attention', BAD = 'bad', UNKNOWN = 'unknown';
const LINK_TIMEOUT = 3;         // [s]

/** Limits from which a value deserves attention, and from which it is bad. */
const LOSS = [0.3, 0.7], ROUND_TRIP = [0.3, 1], SIGNAL = [-70, -80], CHARGE = [0.3, 0.15];

const known = (value) => value !== null && value !== undefined;

function level(value, [attention, bad]) {
  const sign = bad > attention ? 1 : -1;
  return sign * value >= sign * bad ? BAD : sign * value >= sign * attention ? ATTENTION : GOOD;
}

const limited = (label, value, limits, text) => (known(value) ? [label, text(value), level(value, limits)] : [label, '-', UNKNOWN]);

function link(state) {
  if (!known(state.silence)) return ['NO LINK', 'yet', BAD];
  if (state.silence > LINK_TIMEOUT) return ['NO LINK', duration(state.silence), BAD];
  const {sent, capacity} = state.link || {};
  if (!known(sent)) return ['LINK', '-', UNKNOWN];
  return ['LINK Mbit/s', known(capacity) ? `${short(sent)} of ${short(capacity)}` : short(sent), GOOD];
}

function battery(state) {
  const {charge, voltage} = state.battery || {};
  const volts = known(voltage) ? withUnit(voltage, 1, 'V') : '';
  if (!known(charge)) return ['BATTERY', volts || '-', volts ? GOOD : UNKNOWN];
  return ['BATTERY', `${percent(charge)} ${volts}`.trim(), level(charge, CHARGE)];
}

function drives(state) {
  if (state.mine) {
    return state.browser === 'this' ? ['DRIVES', 'you', GOOD] :
      ['DRIVES', state.browser === 'other' ? 'another browser' : 'this desk', ATTENTION];
  }
  return state.driver ? ['DRIVES', state.driver, ATTENTION] : ['DRIVES', 'nobody', UNKNOWN];
}

/** Whether commands leave, perhaps only after one at rest. */
export function isFree(state) {
  return (state.control || '').startsWith('in control');
}

function stop(state) {
  if (state.estop) return ['STOP', 'EMERGENCY STOP', BAD];
  if (isFree(state)) return ['STOP', state.control.replace('in control', 'free').replace(':', ','), GOOD];
  return ['STOP', state.control || '-', state.mine ? ATTENTION : UNKNOWN];
}

/** The weaker of both sides' signals. */
function signal(state) {
  const values = Object.values(state.wifi || {}).map((side) => side && side.signal).filter(known);
  return values.length ? Math.min(...values) : null;
}

/** The tiles of a state: [[label, text, level]]. While the link is broken its values are unknown. */
export function tilesOf(state) {
  const broken = !known(state.silence) || state.silence > LINK_TIMEOUT;
  const values = broken ? {} : state.link || {};
  return [
    link(state),
    limited('LOSS', values.loss, LOSS, percent),
    limited('ROUND TRIP', values.round_trip, ROUND_TRIP, milliseconds),
    limited('WI-FI', broken ? null : signal(state), SIGNAL, (value) => withUnit(value, 0, 'dBm')),
    battery(state),
    ...(state.gas || []).map((gas) =>
      [gas.name.toUpperCase(), known(gas.value) ? `${short(gas.value)} ${gas.unit}`.trim() : '-', known(gas.value) ? GOOD : UNKNOWN]),
    ['FOCUS', (state.focus || '-') + (state.modified ? '*' : ''), state.focus ? GOOD : UNKNOWN],
    drives(state),
    stop(state)];
}

/** Elements that show tiles, made once and changed. */
export class StatusTiles {
  constructor(place) {
    this.place = place;
  }

  show(tiles) {
    while (this.place.children.length > tiles.length) this.place.lastChild.remove();
    while (this.place.children.length < tiles.length) {
      this.place.append(make('div', {class: 'tile'}, make('dt', {}), make('dd', {})));
    }
    tiles.forEach(([label, text, level_], index) => {
      const tile = this.place.children[index];
      setData(tile, 'level', level_);
      setText(tile.firstChild, label);
      setText(tile.lastChild, text);
    });
  }
}
