# SPDX-License-Identifier: BSD-3-Clause
"""Which layers, with which thresholds, promise the best image at a budget of bytes, for a distribution of losses.

Bytes of the stream are worth what the error falls by. A layer of threshold t costs 1 / t of its bytes in each datagram,
and is restored with the probability that t datagrams come. At a price for bytes in a datagram each part of the stream
takes the threshold where probability times worth exceeds the cost by most. Only points on the upper convex hulls of
both curves, worth over bytes and probability over 1 / t, are ever best (H. Everett, Operations Research 11(3), 1963;
for this use A. Mohr, R. Ladner, E. Riskin, ICIP 2000). The price that just fills the datagrams is found by bisection.

More and smaller datagrams than necessary allow finer thresholds and vary less, but have more headers: some numbers are
tried.
"""
import functools
import math
from typing import List, Mapping, NamedTuple, Optional, Tuple

import numpy as np

from ...arrays import Array, FloatArray, IntArray
from .pieces import MAX_COUNT, MAX_LAYERS, Layer, Plan, codes_of, parts_of

LAYER_BYTES = 4
"""A layer's entry in the table of each datagram: threshold, size of a piece, error [byte]."""

FINENESS = 1.0, 1.5, 2.0, 3.0
"""Numbers of datagrams that are tried, in terms of the smallest one."""

FINER_GAIN = 0.004
"""What each time the smallest number of datagrams must gain at least, in terms of the worth of the whole stream."""

MIN_PIECES = 64
"""Datagrams of less are not tried [byte]."""

NOTHING = 10 ** 0.1
"""No image is worse than the stream's head, a uniform image, by this factor of the mean squared error: 1 dB."""

COUNT_FLOOR, COUNT_POWER = 0.02, 1 / 16
"""Images of 16 bits are worth minus this power of their mean squared error [count^2] and a little: nearly its
logarithm, but large errors weigh more, as they do in a mean. With the rms error itself, plans for uncertain losses
would care for the improbable heavy ones only."""

CERTAIN = 1e-4
"""Probabilities of failure below this are not distinguished."""

BISECTIONS = 20
CACHED = 64
"""Numbers of datagrams whose probabilities are cached."""


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
    smallest = _fewest(budget, head, room)
    best: Tuple[float, Optional[Plan]] = -math.inf, None
    for fineness in FINENESS:
        count = min(int(smallest * fineness), MAX_COUNT)
        count += -count % codes_of(count)
        space = min(budget // count - head, room)
        if space < MIN_PIECES and (best[1] is not None or space <= LAYER_BYTES):
            break
        likely = survival(count, losses, burst)
        layers = _fit(_price_layers(curve, count, likely, space), space, count, int(ends[-1]))
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


def promised(count: int, layers: List[Layer], ends: IntArray, values: FloatArray, likely: FloatArray) -> float:
    """The expected worth of what a receiver restores.

    :param likely: as `survival` returns it
    """
    bytes_of_layers = [layer.length(count) for layer in layers]
    prefixes = np.interp(np.cumsum([0] + bytes_of_layers), np.concatenate([[0.0], ends]), values)
    probabilities = likely[[layer.threshold - 1 for layer in layers]]
    return float(values[0] + (np.diff(prefixes) * probabilities).sum())


def survival(count: int, losses: Mapping[float, float], burst: Optional[float]) -> FloatArray:
    """(length,) the probability that a layer of threshold 1, 2, ... is restored; length: of a code.

    :param count: datagrams, a multiple of codes_of(count)
    """
    return np.array(list(losses.values())) @ _survivals(count, tuple(losses), burst)


@functools.lru_cache(maxsize=CACHED)
def _survivals(count: int, losses: Tuple[float, ...], burst: Optional[float]) -> FloatArray:
    """(losses, length): as `survival`, for each loss."""
    loss: FloatArray = np.clip(np.array(losses, float), 1e-6, 1 - 1e-6)
    recovery: FloatArray = 1 - loss if burst is None else np.minimum(1 / burst, 1 - loss)
    codes = codes_of(count)
    length = count // codes
    at_least = _at_least(length, loss, recovery)
    if codes > 1:
        # datagrams that take turns: runs of lost ones are shorter, and each code needs its part
        in_turns = _at_least(length, loss, np.minimum(recovery * codes, 1 - loss)) ** codes
        # copies: a piece is lost where all are
        at_least = _at_least(length, loss ** codes, 1 - (1 - recovery) ** codes)
        own = [parts_of(threshold, count) > 1 for threshold in range(1, length + 1)]
        at_least = np.where(own, in_turns, at_least)
    at_least[at_least > 1 - CERTAIN] = 1.0
    at_least.setflags(write=False)
    return at_least


def _at_least(count: int, loss: FloatArray, recovery: FloatArray) -> FloatArray:
    """(losses, count): the probability that 1, 2, ... of `count` datagrams come."""
    from_most = np.cumsum(arrivals(count, loss, recovery)[:, ::-1], axis=1)
    probabilities: FloatArray = np.minimum(from_most[:, -2::-1], 1.0)
    return probabilities


def arrivals(count: int, loss: FloatArray, recovery: FloatArray) -> FloatArray:
    """How likely each number of datagrams comes by a Gilbert channel (E. Gilbert, BSTJ 39, 1960).

    The channel is good or bad; datagrams are lost while it is bad. The generating function of the number that comes
    follows from the powers of a 2 x 2 matrix; a Fourier transform of its values on the unit circle inverts it.

    :param loss: (m,) in 0..1, both excluded: how often the channel is bad
    :param recovery: (m,) probability that it is good after a datagram that was lost; 1 - loss: losses are independent
    :return: (m, count + 1)
    """
    z = np.exp(-2j * np.pi * np.arange((count + 1) // 2 + 1) / (count + 1))
    loss, recovery = loss[:, np.newaxis], recovery[:, np.newaxis]
    memory = 1 - recovery / (1 - loss)      # the second eigenvalue of the transitions
    # sums of the probabilities of all paths, weighted by z to the number of arrivals, follow a linear recurrence
    trace = (1 - loss * (1 - memory)) * z + 1 - recovery
    determinant = memory * z
    root = np.sqrt(trace * trace - 4 * determinant)
    root[np.abs(root) < 1e-9] = 1e-9
    one, other = (trace + root) / 2, (trace - root) / 2
    one_power, other_power = _power(one, count - 1), _power(other, count - 1)
    values = (((1 - loss) * z + loss) * (one_power * one - other_power * other)
              - determinant * (one_power - other_power)) / root
    probabilities: FloatArray = np.fft.irfft(values, count + 1, axis=1)
    return np.maximum(probabilities, 0.0, out=probabilities)


def _power(base: Array, exponent: int) -> Array:
    """By squaring: numpy's own power is slow above 100."""
    result = np.ones_like(base)
    while exponent:
        if exponent & 1:
            result = result * base
        base, exponent = base * base, exponent >> 1
    return result


def upper_hull(x: FloatArray, y: FloatArray) -> Curve:
    """The upper convex hull of points with ascending x, up to the highest one."""
    kept: List[int] = []
    xs, ys = x.tolist(), y.tolist()
    for i in range(int(np.argmax(y)) + 1):
        while len(kept) > 1 and (ys[i] - ys[kept[-1]]) * (xs[kept[-1]] - xs[kept[-2]]) >= (
                ys[kept[-1]] - ys[kept[-2]]) * (xs[i] - xs[kept[-1]]):
            kept.pop()
        if not kept or xs[i] > xs[kept[-1]]:
            kept.append(i)
    points = np.array(kept)
    return Curve(x[points], y[points], points)


def _price_layers(curve: Curve, count: int, likely: FloatArray, space: int) -> List[Layer]:
    """The layers that are worth most at the price that fills the datagrams."""
    sizes = np.diff(curve.x)
    if not len(sizes):
        return []
    slopes = np.diff(curve.y) / sizes
    # thresholds from the highest, cheapest one on; the first point is to leave a part of the stream out
    thresholds = np.arange(len(likely), 0, -1)
    pieces = [threshold * parts_of(threshold, count) for threshold in thresholds.tolist()]
    protection = upper_hull(np.concatenate([[0.0], 1 / np.array(pieces)]), np.concatenate([[0.0], likely[::-1]]))
    shares = protection.x[1:]
    gains = np.diff(protection.y) / np.diff(protection.x)

    def taken(price: float) -> FloatArray:
        """Bytes of each threshold's pieces at this price."""
        choice = np.searchsorted(-gains, -price / slopes)
        return np.bincount(choice, sizes, len(gains) + 1)[1:] * shares

    available = max(space - LAYER_BYTES * min(len(gains), MAX_LAYERS // 2), space // 2)
    # dearer than anything, and cheaper than everything
    high, low = math.log(slopes[0] * gains[0] * 1.01), math.log(slopes[-1] * gains[-1] * 0.99)
    few, many = taken(math.exp(high)), taken(math.exp(low))
    if many.sum() > available:
        for _ in range(BISECTIONS):
            middle = taken(math.exp((low + high) / 2))
            if middle.sum() > available:
                low, many = (low + high) / 2, middle
            else:
                high, few = (low + high) / 2, middle
        # a part of the stream changes its threshold at the exact price: some of it does
        part = (available - few.sum()) / (many.sum() - few.sum())
        many = (1 - part) * few + part * many
    bytes_of_points = np.ceil(many - 1e-9)
    return [Layer(int(thresholds[protection.points[i + 1] - 1]), int(bytes_of_points[i]))
            for i in np.flatnonzero(bytes_of_points)[::-1]]


def _fit(layers: List[Layer], space: int, count: int, total: int) -> List[Layer]:
    """At most MAX_LAYERS, that fill the space of a datagram or hold the whole stream.

    :param total: length of the stream [byte]
    """
    layers = list(layers) or [Layer(1, 1)]
    while len(layers) > MAX_LAYERS:
        # the smallest joins the one before, which is protected better
        i = min(range(1, len(layers)), key=lambda number: layers[number].size)
        before, own = layers[i - 1:i + 1]
        joined = own.length(count) / (before.threshold * parts_of(before.threshold, count))
        layers[i - 1:i + 1] = [Layer(before.threshold, before.size + math.ceil(joined))]
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
    layers[-1] = Layer(last.threshold, last.size + min(spare, max(0, -(-missing // pieces))))
    return layers
