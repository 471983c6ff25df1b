// SPDX-License-Identifier: BSD-3-Clause
/** A binary frame of the WebSocket: 16 bytes, metadata as JSON, data. doc/web_protocol.md describes it. */

export const Kind = Object.freeze({IMAGE: 1, TILE: 2, AGES: 3, POINTS: 4, CLOUD: 5});

const HEADER = 16;
const TEXT = new TextDecoder();

/**
 * The parts of a frame.
 * @param {ArrayBuffer} buffer
 * @throws {RangeError|SyntaxError} it is shorter than it says, or its metadata are no JSON
 */
export function parse(buffer) {
  const header = new DataView(buffer, 0, HEADER);
  const metaSize = header.getUint32(8, true);
  const dataSize = header.getUint32(12, true);
  return {
    kind: header.getUint8(0), level: header.getUint8(1), index: header.getUint16(2, true),
    number: header.getUint32(4, true), meta: JSON.parse(TEXT.decode(new Uint8Array(buffer, HEADER, metaSize))),
    data: new Uint8Array(buffer, HEADER + metaSize, dataSize)};
}

/** The pixels of a frame's JPEG or PNG, decoded outside the page's thread. */
export function decode(data, type) {
  return createImageBitmap(new Blob([data], {type}), {colorSpaceConversion: 'none', premultiplyAlpha: 'none'});
}
