# SPDX-License-Identifier: BSD-3-Clause
"""The expected quality of protected layered images, without simulating losses one by one.

Each prefix that a receiver can have is decoded for real; how likely it is follows from the plan.
"""
import math
from typing import Callable, Dict, Mapping, NamedTuple, Optional, Tuple

import numpy as np

from smokebot_udp.arrays import Array
from smokebot_udp.codecs.layered.image import LayeredStream, decode, encode
from smokebot_udp.codecs.layered.pieces import Plan, Restorer, parts_of, protect
from smokebot_udp.codecs.layered.plan import best_plan, promised, worth
from smokebot_udp.codecs.layered.survival import survival

HEAD = 88 + 5
"""Size of a datagram on the air without its pieces: 60 bytes of message, 28 of IP and UDP, 5 of the table without its
layers [byte]."""

ROOM = 1500 - HEAD
PSNR_FLOOR = 0.065
"""Mean squared error at a PSNR of 60 dB [count^2]."""

Losses = Mapping[float, float]


class Air(NamedTuple):
    """What a link does to datagrams, or is expected to do."""
    losses: Losses
    """{packet loss: its probability}"""
    burst: Optional[float] = None
    """Mean number of datagrams lost in a row; None: losses are independent."""


class Coded:
    """An image, its streams, and the errors of their prefixes.

    :param image: (height, width) uint8 or uint16
    """

    def __init__(self, image: Array) -> None:
        self._image = image
        self._floor = PSNR_FLOOR if image.itemsize == 1 else None
        room = 2 * image.nbytes
        self._streams: Dict[bool, LayeredStream] = {exact: encode(image, exact, room) for exact in (False, True)}
        self._errors: Dict[Tuple[bool, int], float] = {}

    @property
    def lossless_size(self) -> int:
        """The size of the exact stream [byte]."""
        return len(self._streams[True].data)

    def plan(self, budget: int, air: Air) -> Tuple[bool, Plan]:
        """Which stream, the exact one or the other, and its plan: what promises more."""
        found = []
        for lossless, stream in self._streams.items():
            values = worth(stream.errors, stream.cells, self._floor)
            plan = best_plan(stream.ends, values, budget, air.losses, air.burst, HEAD, ROOM)
            likely = survival(plan.count, air.losses, air.burst)
            found.append((promised(plan.count, plan.layers, stream.ends, values, likely), lossless, plan))
        _, lossless, plan = max(found, key=lambda one: one[0])
        return lossless, plan

    def expected(self, lossless: bool, plan: Plan, air: Air, quality: Callable[[float], float]) -> float:
        """The expected quality of what a receiver shows.

        :param quality: f(mean squared error)
        """
        sizes = [layer.size * layer.threshold * parts_of(layer.threshold, plan.count) for layer in plan.layers]
        shown = [quality(self.error(lossless, int(size))) for size in np.cumsum([0] + sizes)]
        likely = survival(plan.count, air.losses, air.burst)
        probabilities = likely[[layer.threshold - 1 for layer in plan.layers]]
        return float(shown[0] + (np.diff(shown) * probabilities).sum())

    def error(self, lossless: bool, size: int) -> float:
        """The mean squared error of a prefix; without any the image is uniform: its mean, or grey of 8 bits."""
        size = min(size, len(self._streams[lossless].data))
        if (lossless, size) not in self._errors:
            self._errors[lossless, size] = self._measured(self._streams[lossless].data[:size])
        return self._errors[lossless, size]

    def simulated(self, lossless: bool, plan: Plan, received: Array) -> float:
        """The mean squared error where these datagrams are received: protected, lost and restored for real.

        :param received: (n,) bool
        """
        restorer = Restorer(plan.count, plan.layers)
        indexes = np.flatnonzero(received)
        restorer.add(indexes, protect(self._streams[lossless].data, plan)[indexes])
        return self._measured(restorer.restored() if restorer.restorable else b'')

    def _measured(self, data: bytes) -> float:
        decoded = decode(data, self._image.shape[0], self._image.shape[1], 1, self._image.itemsize)
        nothing = self._image.mean() if self._floor is None else 128.0
        shown: Array = np.array(nothing) if decoded is None else decoded.pixels
        return float(((shown.astype(float) - self._image) ** 2).mean())


def psnr(error: float) -> float:
    """The PSNR of a mean squared error of 8-bit pixels, at most 60 [dB]."""
    return 60.0 if error <= 0 else min(60.0, 10 * math.log10(255 ** 2 / error))
