# SPDX-License-Identifier: BSD-3-Clause
"""Priority encoding of an embedded stream: whoever has any k of an image's datagrams has a prefix of it, the longer the
larger k is (A. Mohr, E. Riskin, R. Ladner, Unequal loss protection, IEEE JSAC 18(6), 2000; R. Puri, K. Ramchandran,
Multiple description source coding through forward error correction codes, Asilomar 1999).

The stream is cut in layers. Each layer is cut in pieces of one size, as many as its threshold, and an erasure code
extends them to one piece for each datagram. A datagram has one piece of each layer, in order. Thresholds rise along the
stream.

Above GROUP datagrams one code is not enough. Then there are as many codes of equal length as it takes, and
* a layer of a low threshold has the same pieces in each code, every `length` datagrams: copies are far apart;
* any other layer is cut in parts, one for each code. The datagrams take turns, and all parts need their threshold.
"""
from dataclasses import dataclass
from typing import Dict, List, NamedTuple, Sequence

import numpy as np

from ...arrays import BoolArray, IntArray, UInt8Array
from . import erasure

GROUP = 240
"""Maximum number of datagrams of one code."""

MAX_COUNT = 4080
"""Maximum number of datagrams of an image."""

MAX_LAYERS = 14

MAX_SIZE = 16 << 20
"""Maximum size of all pieces of an image together [byte]."""

REPEATED = 3
"""With several codes, pieces are repeated where the threshold is at most this part of a code's length: a third."""


class Layer(NamedTuple):
    """A part of the stream."""
    threshold: int
    """Number of pieces that restore the layer; where datagrams take turns, number of pieces of each code."""
    size: int
    """Size of a piece [byte]."""

    def length(self, count: int) -> int:
        """The number of bytes of the stream that the layer holds, with `count` datagrams [byte]."""
        return self.threshold * self.size * parts_of(self.threshold, count)


@dataclass(frozen=True)
class Plan:
    """How a stream is protected."""
    count: int
    """Number of datagrams."""
    layers: List[Layer]


def codes_of(count: int) -> int:
    """The number of codes of that many datagrams; `count` must be a multiple of it."""
    return -(-count // GROUP)


def parts_of(threshold: int, count: int) -> int:
    """The number of parts of a layer, each of `threshold` pieces: one if all codes have the same pieces."""
    return 1 if threshold <= most_repeated(count) else codes_of(count)


def most_repeated(count: int) -> int:
    """The highest threshold of layers that have the same pieces in each code."""
    return count // (REPEATED * codes_of(count))


def check(count: int, layers: Sequence[Layer]) -> None:
    """Check a plan from elsewhere.

    :raises ValueError: it contradicts itself, or exceeds a limit
    """
    if not 0 < count <= MAX_COUNT or count % codes_of(count):
        raise ValueError('%d datagrams cannot be, nor more than %d' % (count, MAX_COUNT))
    if not 0 < len(layers) <= MAX_LAYERS:
        raise ValueError('there are %d layers, must be from 1 to %d' % (len(layers), MAX_LAYERS))
    length = count // codes_of(count)
    lowest = 1
    for layer in layers:
        if not lowest <= layer.threshold <= length or layer.size < 1:
            raise ValueError('thresholds do not rise from 1 to %d, or a piece is empty: %s' % (length, layers))
        lowest = layer.threshold + 1
    if count * sum(layer.size for layer in layers) > MAX_SIZE:
        raise ValueError('the pieces have more than %d bytes' % MAX_SIZE)


def protect(data: bytes, plan: Plan) -> UInt8Array:
    """The pieces of each datagram.

    :param data: the stream; what is beyond the layers is left out, and zeros fill the last layer
    :return: (n, s) uint8: a row for each datagram, its pieces in the order of the layers
    :raises ValueError: the plan contradicts itself, or exceeds a limit
    """
    count, layers = plan.count, plan.layers
    check(count, layers)
    pieces = np.empty((count, sum(layer.size for layer in layers)), np.uint8)
    stream = np.frombuffer(data, np.uint8)
    column = 0
    for threshold, size in layers:
        for datagrams in _datagrams(threshold, count):
            part, stream = stream[:threshold * size], stream[threshold * size:]
            source = np.zeros((threshold, size), np.uint8)
            source.reshape(-1)[:len(part)] = part
            code = np.vstack([source, erasure.extend(source, datagrams.shape[1])])
            pieces[datagrams, column:column + size] = code
        column += size
    return pieces


def _datagrams(threshold: int, count: int) -> List[IntArray]:
    """For each part of a layer (copies, length) int: which datagrams have which piece of its code."""
    codes = codes_of(count)
    if parts_of(threshold, count) == 1:
        return [np.arange(count).reshape(codes, -1)]
    return [np.arange(code, count, codes)[np.newaxis] for code in range(codes)]


class Restorer:
    """Restores the stream of one image from its datagrams, in any order.

    :param count: datagrams of the image
    :param layers: as the datagrams declare them
    :raises ValueError: these contradict themselves, or exceed a limit
    """

    def __init__(self, count: int, layers: Sequence[Layer]) -> None:
        count, layers = int(count), [Layer(int(layer.threshold), int(layer.size)) for layer in layers]
        check(count, layers)
        self.restorable = 0
        """Layers that can be restored now: the first ones, without gaps."""
        self._layers = layers
        self._received = np.zeros(count, bool)
        self._pieces = np.empty((count, sum(layer.size for layer in layers)), np.uint8)
        self._restored: Dict[int, bytes] = {}       # {layer: its bytes}

    @property
    def complete(self) -> bool:
        """Whether all layers can be restored."""
        return self.restorable == len(self._layers)

    @property
    def completeness(self) -> float:
        """Received share of the datagrams, 0..1."""
        return float(np.count_nonzero(self._received)) / len(self._received)

    @property
    def awaited(self) -> int:
        """The index of the missing datagram that matters last: where neither it nor a missing one before it comes, the
        next layer cannot be restored. Not to be asked of a complete image."""
        threshold = self._layers[self.restorable].threshold
        awaited = len(self._received) - 1
        for datagrams in _datagrams(threshold, len(self._received)):
            came = self._received[datagrams].any(axis=0)
            needed = threshold - int(np.count_nonzero(came))
            if needed > 0:      # of each missing piece the last copy counts
                awaited = min(awaited, int(np.sort(datagrams[-1][~came])[-needed]))
        return awaited

    def add(self, indexes: IntArray, pieces: UInt8Array) -> BoolArray:
        """Add datagrams.

        :param indexes: (m,) int, any
        :param pieces: (m, s) uint8; where s is not the sum of the layers' sizes, none fits
        :return: (m,) bool, those that fit and are new; the others were dropped
        """
        count = len(self._received)
        good: BoolArray = (indexes >= 0) & (indexes < count)
        if pieces.shape[1] != self._pieces.shape[1]:
            good[:] = False
        good[good] = ~self._received[indexes[good]]
        _, first = np.unique(indexes, return_index=True)
        once = np.zeros(len(indexes), bool)
        once[first] = True
        good &= once
        if good.any():
            new = indexes[good]
            self._pieces[new], self._received[new] = pieces[good], True
            while not self.complete and self._is_restorable(self._layers[self.restorable].threshold):
                self.restorable += 1
        return good

    def restored(self) -> bytes:
        """The prefix of the stream that the restorable layers hold, and what was received of the stream right after."""
        column = 0
        stream: List[bytes] = []
        for number, (_, size) in enumerate(self._layers):
            if number not in self._restored:
                parts = self._parts(number, column)
                if number == self.restorable:
                    return b''.join(stream + parts)
                self._restored[number] = b''.join(parts)
            stream.append(self._restored[number])
            column += size
        return b''.join(stream)

    def _is_restorable(self, threshold: int) -> bool:
        return all(np.count_nonzero(self._received[datagrams].any(axis=0)) >= threshold
                   for datagrams in _datagrams(threshold, len(self._received)))

    def _parts(self, number: int, column: int) -> List[bytes]:
        """What can be restored of a layer: its parts, the last one perhaps cut."""
        threshold, size = self._layers[number]
        parts: List[bytes] = []
        for datagrams in _datagrams(threshold, len(self._received)):
            received = self._received[datagrams]
            indexes = np.flatnonzero(received.any(axis=0))[:threshold]
            if len(indexes) < threshold:    # the first pieces are the source itself: those before a gap
                indexes = indexes[indexes == np.arange(len(indexes))]
            rows = datagrams[received.argmax(axis=0), np.arange(datagrams.shape[1])][indexes]
            pieces = self._pieces[rows, column:column + size]
            if len(indexes) < threshold:
                return parts + [pieces.tobytes()]
            parts.append(erasure.recover(indexes, pieces).tobytes())
        return parts
