# SPDX-License-Identifier: BSD-3-Clause
"""Which layers, with which thresholds, promise the best image at a budget of bytes, for a distribution of losses.

Bytes of the stream are worth what the error falls by. A layer of threshold t costs 1 / t of its bytes in each datagram,
and is restored with the probability that t datagrams come. At a price for bytes in a datagram each part of the stream
takes the threshold where probability times worth exceeds the cost by most. Only points on the upper convex hulls of
both curves, worth over bytes and probability over 1 / t, are ever best (H. Everett, Operations Research 11(3), 1963;
for this use A. Mohr, R. Ladner, E. Riskin, ICIP 2000). The price that just fills the datagrams is found by bisection.

More and smaller datagrams than necessary allow finer thresholds and vary less, but have more headers: some numbers are
tried. Where much is lost, an image has so many that one of them comes nearly always, and nearly any datagrams restore
its first layer: without it, it is not shown.
"""
import math
from typing import List, Mapping, NamedTuple, Optional, Tuple

import numpy as np

from ...arrays import FloatArray, IntArray
from .pieces import MAX_COUNT, MAX_LAYERS, Layer, Plan, codes_of, most_repeated, parts_of
from .prices import filling_bytes, hull_points
from .survival import SURE, sure_count, survival

LAYER_BYTES = 4
"""A layer's entry in the table of each datagram: threshold, size of a piece, error [byte]."""

FINENESS = 1.0, 1.5, 2.0, 3.0
"""Numbers of datagrams that are tried, in terms of the smallest one."""

FINER_GAIN = 0.004
"""What each time the smallest number of datagrams must gain at least, in terms of the worth of the whole stream."""

MIN_PIECES = 64
"""Datagrams of less are not tried [byte]."""

MOST_LOSS = 0.99
"""Heavier packet losses count as this one."""

MOST_HEADS = 0.25
"""Part of the budget that the heads of these may take: nothing is gained where what follows them restores little."""

PESSIMISM = 0.85
"""One of the datagrams comes nearly always at a packet loss that is not exceeded with this probability."""

NOTHING = 10 ** 0.1
"""No image is worse than the stream's head, a uniform image, by this factor of the mean squared error: 1 dB."""

COUNT_FLOOR, COUNT_POWER = 0.02, 1 / 16
"""Images of 16 bits are worth minus this power of their mean squared error [count^2] and a little: nearly its
logarithm, but large errors weigh more, as they do in a mean. With the rms error itself, plans for uncertain losses
would care for the improbable heavy ones only."""


class Curve(NamedTuple):
    """The upper convex hull of some points, from left to right."""
    x: FloatArray
    y: FloatArray
    points: IntArray
    """Which points these are."""


def worth(errors: FloatArray, cells: int, floor: Optional[float]) -> FloatArray:
    """What prefixes of a stream are worth.

    :param errors: (s,) sums of squared errors, see image.LayeredStream
    :param cells: number of values of the image
    :param floor: of 8 bits; mean squared errors much below are not distinguished, and worth is in dB. None: 16 bits
    :return: (s + 1,), the first without anything
    """
    mean = np.maximum(np.concatenate([errors[:1] * NOTHING, errors]), 0) / cells
    values: FloatArray = -(mean + COUNT_FLOOR) ** COUNT_POWER if floor is None else -10 * np.log10(mean + floor)
    return values


def best_plan(ends: IntArray, values: FloatArray, budget: int, losses: Mapping[float, float], burst: Optional[float],
              head: int, room: int) -> Plan:
    """The plan that promises most.

    :param ends: (s,) int, ascending: truncation points of the stream [byte]
    :param values: (s + 1,), see `worth`
    :param budget: of the image on the air, all headers included [byte]
    :param losses: {packet loss: its probability}
    :param burst: mean number of datagrams lost in a row; None: losses are independent
    :param head: of a datagram on the air with an empty table and no pieces [byte]
    :param room: largest sum of a datagram's table and pieces [byte]
    :raises ValueError: the budget or the room is too small for one useful datagram
    """
    curve = upper_hull(np.concatenate([[0.0], ends]), values)
    sure = min(_sure_count(losses, burst), int(budget * MOST_HEADS / max(head, MIN_PIECES)))
    smallest = _fewest(budget, head, room)
    best: Tuple[float, Optional[Plan]] = -math.inf, None
    tried = 0
    for fineness in FINENESS:
        count = min(max(int(smallest * fineness), sure), MAX_COUNT)
        count += -count % codes_of(count)
        if count == tried:
            continue
        tried = count
        space = min(budget // count - head, room)
        if space < MIN_PIECES and (best[1] is not None or space <= LAYER_BYTES):
            break
        likely = survival(count, losses, burst)
        layers = _fit(_price_layers(curve, count, likely, space), space, count, int(ends[-1]))
        layers = _sure_first(layers, likely, int(ends[0]))
        promise = promised(count, layers, ends, values, likely) - FINER_GAIN * fineness * float(values[-1] - values[0])
        if promise > best[0]:
            best = promise, Plan(count, layers)
    if best[1] is None:
        raise ValueError('%d bytes, %d in a datagram, are too few for headers of %d' % (budget, room, head))
    return best[1]


def _fewest(budget: int, head: int, room: int) -> int:
    """The number of datagrams that hold the budget; less the last one where it would take nearly all for its head."""
    fewest = max(-(-budget // (head + room)), 1)
    return fewest if budget // fewest - head >= MIN_PIECES else max(budget // (head + room), 1)


def sure_size(losses: Mapping[float, float], burst: Optional[float], head: int) -> float:
    """With this budget an image has so many datagrams that one of them nearly always comes [byte].

    :param losses, burst, head: as of best_plan
    """
    return _sure_count(losses, burst) * max(head, MIN_PIECES) / MOST_HEADS


def _sure_count(losses: Mapping[float, float], burst: Optional[float]) -> int:
    """The number of datagrams of which one nearly always comes."""
    total = 0.0
    for loss in sorted(losses):
        total += losses[loss]
        if total >= PESSIMISM:
            break
    return sure_count(min(loss, MOST_LOSS), burst)


def _sure_first(layers: List[Layer], likely: FloatArray, least: int) -> List[Layer]:
    """The layers with the first one restored with the probability SURE, or by any datagram that can hold it.

    :param least: of the stream that shows an image [byte]
    """
    most = max(int(np.count_nonzero(likely >= SURE)), -(-least // layers[0].size))
    return [Layer(min(layer.threshold, most), layer.size) for layer in layers[:1]] + layers[1:]


def promised(count: int, layers: List[Layer], ends: IntArray, values: FloatArray, likely: FloatArray) -> float:
    """The expected worth of what a receiver restores.

    :param likely: as `survival` returns it
    """
    bytes_of_layers = [layer.length(count) for layer in layers]
    prefixes = np.interp(np.cumsum([0] + bytes_of_layers), np.concatenate([[0.0], ends]), values)
    probabilities = likely[[layer.threshold - 1 for layer in layers]]
    return float(values[0] + (np.diff(prefixes) * probabilities).sum())


def upper_hull(x: FloatArray, y: FloatArray) -> Curve:
    """The upper convex hull of points with ascending x, up to the highest one."""
    points = hull_points(x, y)
    return Curve(x[points], y[points], points)


def _price_layers(curve: Curve, count: int, likely: FloatArray, space: int) -> List[Layer]:
    """The layers that are worth most at the price that fills the datagrams."""
    sizes = np.diff(curve.x)
    if not len(sizes):
        return []
    slopes = np.diff(curve.y) / sizes
    # thresholds from the highest, cheapest one on; the first point is to leave a part of the stream out
    thresholds = np.arange(len(likely), 0, -1)
    pieces = thresholds * np.where(thresholds <= most_repeated(count), 1, codes_of(count))
    protection = upper_hull(np.concatenate([[0.0], 1 / pieces]), np.concatenate([[0.0], likely[::-1]]))
    gains = np.diff(protection.y) / np.diff(protection.x)
    table = min(len(gains), MAX_LAYERS // 2)
    for _ in range(2):      # again where the table is longer than was thought
        available = max(space - LAYER_BYTES * table, space // 2)
        bytes_of_points = np.ceil(filling_bytes(float(available), slopes, sizes, gains, protection.x[1:]) - 1e-9)
        used = np.count_nonzero(bytes_of_points)
        if used <= table:
            break
        table = min(used, MAX_LAYERS)
    return [Layer(int(thresholds[protection.points[i + 1] - 1]), int(bytes_of_points[i]))
            for i in np.flatnonzero(bytes_of_points)[::-1]]


def _fit(layers: List[Layer], space: int, count: int, total: int) -> List[Layer]:
    """At most MAX_LAYERS, that fill the space of a datagram or hold the whole stream.

    :param total: length of the stream [byte]
    """
    layers = list(layers) or [Layer(1, 1)]
    while len(layers) > MAX_LAYERS or len(layers) > 1 and sum(layer.size + LAYER_BYTES for layer in layers) > space:
        # the smallest joins the one behind it, which is protected less: else the end of the stream would be cut
        i = min(range(len(layers) - 1), key=lambda number: layers[number].size)
        own, behind = layers[i:i + 2]
        joined = own.length(count) / (behind.threshold * parts_of(behind.threshold, count))
        layers[i:i + 2] = [Layer(behind.threshold, behind.size + math.ceil(joined))]
    spare = space - sum(layer.size + LAYER_BYTES for layer in layers)
    while spare < 0:
        last = layers.pop()
        spare += last.size + LAYER_BYTES
        if spare > LAYER_BYTES or not layers:
            layers.append(Layer(last.threshold, spare - LAYER_BYTES))
            spare = 0
    last = layers[-1]
    pieces = last.threshold * parts_of(last.threshold, count)
    missing = total - sum(layer.length(count) for layer in layers)
    layers[-1] = Layer(last.threshold, max(1, last.size + min(spare, -(-missing // pieces))))
    return layers
