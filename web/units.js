// SPDX-License-Identifier: BSD-3-Clause
/** Numbers as texts, in the words of the operator's rviz. A number that is unknown, null, is a dash. */

const DURATIONS = [[1, 1, 2, 's'], [100, 1, 1, 's'], [6000, 60, 0, 'min'], [360000, 3600, 0, 'h']];

/** A short text for a time [s]: '0.12 s', '3.2 s', '2 min', '5 h'. */
export function duration(seconds) {
  if (!Number.isFinite(seconds)) return '? s';
  const found = DURATIONS.find(([most]) => Math.abs(seconds) < most);
  return found ? `${(seconds / found[1]).toFixed(found[2])} ${found[3]}` : '> 99 h';
}

/** A time in whole milliseconds. */
export const milliseconds = (seconds) => withUnit(seconds, 0, 'ms', 1e3);

/** A ratio in percent. */
export const percent = (ratio) => withUnit(ratio, 0, '%', 100);

/** Three significant digits. */
export const short = (value) => (value === null || value === undefined ? '-' :
  Math.abs(value) < 100 ? String(Number(value.toPrecision(3))) : value.toFixed(0));

/** A number with its unit. */
export function withUnit(value, digits, unit, factor = 1) {
  return value === null || value === undefined ? '-' : `${(value * factor).toFixed(digits)} ${unit}`.trim();
}

/** A size in bytes: '614 kB'. */
export function size(bytes) {
  if (bytes < 1e3) return `${bytes} B`;
  return bytes < 1e6 ? `${(bytes / 1e3).toFixed(0)} kB` : `${(bytes / 1e6).toFixed(1)} MB`;
}

/** A time of day, of seconds since 1970. */
export const timeOfDay = (stamp) => new Date(stamp * 1e3).toTimeString().slice(0, 8);
