# SPDX-License-Identifier: BSD-3-Clause
"""The robot's side of prediction: which image the next one is predicted from, and what it is predicted to be.

Importing this module loads the compiled codec.
"""
import math
from dataclasses import dataclass
from typing import Callable, Collection, Dict, NamedTuple, Optional, Sequence

import numpy as np

from ...arrays import Array, Records
from ...codecs.layered import motion
from .coded_shape import shape_of
from .held_by_all import HeldByAll
from .references import CodedImage, References

SAMPLED = 4
"""Every fourth row says how much neighbours differ."""

MOVED = 1.2
"""Where there was no motion, it is sought again once the mean squared difference has grown by this factor,"""

SKIPPED = 4
"""or after this number of images."""

PAYS = 2.0
"""A prediction is used where what it leaves has this part of the energy, at most, that neighbours differ by."""


class Prediction(NamedTuple):
    """What an image is coded against."""
    number: int
    """Of the reference."""
    layers: int
    """Of it that are used."""
    checksum: int
    """Of its pixels, see references.checksum_of."""
    motion: bytes
    """Since the reference."""
    pixels: Array
    """The displaced reference: shape and type of the image."""
    error: float
    """Mean squared difference from the image [count^2]."""
    exact_size: float
    """About what the exact difference takes: the entropy of its values, each by itself [byte]. That is too much where
    neighbours differ alike, so where the prediction is poor."""


@dataclass
class _Sent:
    """An image that may serve as a reference."""
    stamp: float
    """[s]"""
    errors: Sequence[float]
    """Mean squared errors of its layers [count^2]."""


class _MotionFinder:
    """Finds the motion since a reference. Where there was none it is sought again after a while only, or once the
    images differ more: it takes longer than coding does."""

    def __init__(self) -> None:
        self._still: Optional[float] = None     # mean squared difference where there was no motion [count^2]
        self._skipped = 0

    def find(self, reference: Array, pixels: Array) -> motion.Motion:
        """The motion from a reference to an image."""
        difference = float(np.square(reference[::SAMPLED].astype(np.float32) - pixels[::SAMPLED]).mean())
        if self._still is not None and difference <= MOVED * self._still and self._skipped < SKIPPED:
            self._skipped += 1
            return motion.NONE
        found = motion.estimate(reference, pixels)
        self._still, self._skipped = None if found else difference, 0
        return found


class Predictor:
    """Predicts the images of one stream, all of one size and encoding between two calls of `begin`.

    :param session: makes random numbers, uint32
    :param held: what the operators report
    """

    def __init__(self, session: Callable[[], int], held: HeldByAll) -> None:
        self._random, self._held = session, held
        self._references = References()
        self.begin()

    def begin(self) -> None:
        """The next image has another size or encoding than those before."""
        self.session, self.number = self._random(), 0
        """Of the next image."""
        self._references.clear()
        self._sent: Dict[int, _Sent] = {}
        self._motion = _MotionFinder()

    def predict(self, pixels: Array, stamp: float, growth: float, names: Collection[str],
                now: float) -> Optional[Prediction]:
        """What the next image is to be coded against; None: nothing that all operators hold is like it.

        :param pixels: of the next image, as the codec takes them
        :param stamp: its time [s]
        :param growth: of the mean squared difference between images with time, see freshness.MotionMeter [count^2/s]
        :param names: of the operators that it is sent to
        :param now: by a steady clock [s]
        """
        held = self._held.layers(names, self.session, self._references.layers(self.session), now)
        if not held:
            return None
        number = min(held, key=lambda number: self._distance(number, held[number], stamp, growth))
        key = self.session, number
        reference = self._references.get(key, held[number], shape_of(pixels))
        if reference is None:
            return None
        self._references.forget_before(key)     # those are never used again: operators forget them, too
        moved = self._motion.find(reference.pixels, pixels)
        displaced = motion.compensate(reference.pixels, moved)
        return _prediction(number, held[number], reference.checksum, motion.to_bytes(moved), displaced, pixels)

    def describe(self, records: Records, prediction: Optional[Prediction]) -> None:
        """Write into the segments of the next image which one it is, and its reference."""
        records['session'], records['picture'] = self.session, self.number
        if prediction is None:
            records['reference'], records['reference_layers'], records['checksum'] = self.number, 0, 0
        else:
            records['reference'], records['reference_layers'] = prediction.number, prediction.layers
            records['checksum'] = prediction.checksum

    def sent(self, image: CodedImage, errors: Sequence[float], prediction: Optional[Prediction], stamp: float,
             names: Collection[str], now: float) -> None:
        """The next image leaves.

        :param errors: mean squared errors once each of its layers is restored, about [count^2]
        """
        # no layer makes an image worse than its prediction is, whose error is known better
        most = math.inf if prediction is None else prediction.error
        self._references.add((self.session, self.number), image)
        kept = self._references.layers(self.session)
        self._sent = {number: sent for number, sent in self._sent.items() if number in kept}
        self._sent[self.number] = _Sent(stamp, [min(error, most) for error in errors])
        self.number += 1
        self._held.sent(names, prediction is not None, now)

    def _distance(self, number: int, layers: int, stamp: float, growth: float) -> float:
        """The mean squared difference of a reference from the scene, about [count^2]."""
        sent = self._sent[number]
        layers = min(layers, len(sent.errors))
        return sent.errors[layers - 1] + growth * abs(stamp - sent.stamp) - 1e-9 * number


def _prediction(number: int, layers: int, checksum: int, moved: bytes, displaced: Array,
                pixels: Array) -> Optional[Prediction]:
    """None where the prediction leaves more than neighbours differ by."""
    residual = pixels.astype(np.int32) - displaced
    error = float(np.square(residual, dtype=np.float32).mean())
    steps = np.square(np.diff(pixels[::SAMPLED].astype(np.float32), axis=1))
    if error * steps.size > PAYS * float(steps.sum()):
        return None
    counts = np.bincount((residual - residual.min()).ravel())
    counts = counts[counts > 0]
    size = float((counts * np.log2(residual.size / counts)).sum()) / 8
    return Prediction(number, layers, checksum, moved, displaced, error, size)
