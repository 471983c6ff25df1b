// SPDX-License-Identifier: BSD-3-Clause
/** Where a map lies on the ground, and which of its tiles an area needs. */

const MAX_LEVEL = 6;
const USUAL_RESOLUTION = 0.05;  // before the map has come [m]

/**
 * The level at which a pixel of a tile is at least one of the screen.
 * @param {number} scale of the screen [device pixel/m]
 */
export function levelFor(scale, resolution = USUAL_RESOLUTION) {
  return Math.min(MAX_LEVEL, Math.max(0, Math.ceil(-Math.log2(scale * resolution))));
}

/** Extend an area [m] outwards to multiples of a tile: it changes seldom while the map moves. */
export function roundOutwards([x0, y0, x1, y1], step) {
  return [Math.floor(x0 / step) * step, Math.floor(y0 / step) * step, Math.ceil(x1 / step) * step, Math.ceil(y1 / step) * step];
}

/** The corners of an area of a map, in its cells, on the ground. @param {Object} map its message */
export function corners(map, [x0, y0, x1, y1]) {
  const [cos, sin] = [Math.cos(map.yaw) * map.resolution, Math.sin(map.yaw) * map.resolution];
  return [[x0, y0], [x1, y0], [x1, y1], [x0, y1]].map(([x, y]) => [map.x + x * cos - y * sin, map.y + x * sin + y * cos]);
}

/** The area on the ground, [x0, y0, x1, y1], of a whole map. */
export function extent(map) {
  const places = corners(map, map.area);
  const xs = places.map(([x]) => x), ys = places.map(([, y]) => y);
  return [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
}

/** Whether a tile of `size` cells meets an area on the ground. */
export function meets(map, column, row, size, [x0, y0, x1, y1]) {
  const places = corners(map, [column * size, row * size, (column + 1) * size, (row + 1) * size]);
  return places.some(([x]) => x >= x0) && places.some(([x]) => x <= x1) &&
    places.some(([, y]) => y >= y0) && places.some(([, y]) => y <= y1);
}
