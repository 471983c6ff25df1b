// SPDX-License-Identifier: BSD-3-Clause
/**
 * The tiles of a map, kept as they came and drawn in colours when they are needed.
 *
 * The server does not repeat a tile that has not changed, so all are kept, as PNG. The pixels of the last that were seen
 * are kept, too.
 */
import {decode} from './frame.js';
import {meets} from './map_place.js';

const MOST_DRAWN = 400;         // tiles with pixels, of 64 kB
const UNKNOWN = [27, 31, 36], FREE = [72, 80, 90], OCCUPIED = [240, 246, 252];

/** The colours of a tile's values: 0 unknown, 1..101 occupancy. (256, 4) bytes, RGBA. */
const COLOURS = new Uint8ClampedArray(1024);
for (let value = 0; value < 256; value++) {
  const ratio = Math.min(1, Math.max(0, (value - 1) / 100));
  const colour = value === 0 ? UNKNOWN : FREE.map((free, channel) => free + ratio * (OCCUPIED[channel] - free));
  COLOURS.set([...colour, 255], value * 4);
}

/** A canvas with the pixels of a grey PNG in colours of a table (256, 4) bytes. */
export async function coloured(data, table) {
  const bitmap = await decode(data, 'image/png');
  const canvas = document.createElement('canvas');
  [canvas.width, canvas.height] = [bitmap.width, bitmap.height];
  const context = canvas.getContext('2d', {willReadFrequently: true});
  context.drawImage(bitmap, 0, 0);
  bitmap.close();
  const image = context.getImageData(0, 0, canvas.width, canvas.height);
  const words = new Uint32Array(image.data.buffer), colours = new Uint32Array(table.buffer);
  for (let index = 0; index < words.length; index++) words[index] = colours[image.data[index * 4]];
  context.putImageData(image, 0, 0);
  return canvas;
}

export class MapTiles {
  /** @param {number} tile pixels of a tile; @param {function} changed called when there is more to be drawn */
  constructor(tile, changed) {
    this.tile = tile;
    this.changed = changed;
    this.clear();
  }

  clear() {
    this.tiles = new Map();     // 'level/column/row' -> {level, column, row, data, canvas, loading}; the last used last
  }

  /** Take a tile's frame. The promise ends when it was drawn. */
  async take(frame) {
    const {column, row} = frame.meta;
    const key = `${frame.level}/${column}/${row}`;
    const former = this.tiles.get(key);
    const tile = {level: frame.level, column, row, data: frame.data.slice(), canvas: former ? former.canvas : null};
    this.tiles.set(key, tile);
    await this.load(tile);
  }

  async load(tile) {
    if (tile.loading) return;
    tile.loading = true;
    tile.canvas = await coloured(tile.data, COLOURS);
    tile.loading = false;
    this.changed();
  }

  /**
   * Draw what there is of an area: coarser tiles first, where finer ones have not come.
   * @param {CanvasRenderingContext2D} context whose unit is a cell, y up, at the map's place
   * @param {Object} map its message
   * @param {number} level that is wanted
   * @param {Array} area on the ground
   * @param {number} overlap by which tiles overlap, so that no gaps are seen [cell]
   */
  draw(context, map, level, area, overlap) {
    const found = [...this.tiles.values()].filter((tile) =>
      tile.level >= level && meets(map, tile.column, tile.row, this.tile << tile.level, area));
    found.sort((a, b) => b.level - a.level);
    for (const tile of found) {
      const size = this.tile << tile.level;
      if (!tile.canvas) {
        this.load(tile);
        continue;
      }
      this.tiles.delete(`${tile.level}/${tile.column}/${tile.row}`);      // it is the last used now
      this.tiles.set(`${tile.level}/${tile.column}/${tile.row}`, tile);
      context.save();
      context.translate(tile.column * size, (tile.row + 1) * size);
      context.scale(1, -1);
      context.drawImage(tile.canvas, 0, 0, size + overlap, size + overlap);
      context.restore();
    }
    this.forget(found);
  }

  /** Drop the pixels of tiles that have not been used for longest. */
  forget(used) {
    const drawn = [...this.tiles.values()].filter((tile) => tile.canvas && !tile.loading);
    for (const tile of drawn.slice(0, -Math.max(MOST_DRAWN, used.length))) tile.canvas = null;
  }
}
