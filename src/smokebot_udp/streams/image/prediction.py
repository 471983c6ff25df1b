# SPDX-License-Identifier: BSD-3-Clause
"""The robot's side of prediction: which image the next one is predicted from, and what it is predicted to be.

Importing this module loads the compiled codec.
"""
import math
from collections import deque
from dataclasses import dataclass
from typing import Callable, Collection, Deque, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from ...arrays import Array, Records
from ...codecs.layered import blend, differences, motion
from .held_by_all import HeldByAll
from .pixel_layers import shape_of
from .references import CodedImage, References

SAMPLED = 4
"""Every fourth row is compared."""

LARGE = 1 << 17
"""Images of more values than this have the size of their differences estimated from every fourth row, too."""

MOVED = 1.2
"""Where there was no motion, it is sought again once the mean squared difference has grown by this factor."""

SKIPPED = 4
"""Where there was no motion, it is sought again after this number of images."""

SAVES, PAUSE = 0.25, 5
"""A prediction that saves less than this part of the bits is not worth the time of the processors: it takes longer than
coding does. After two such in a row PAUSE images have none; so it is with second references that are of no use."""

LAGS = 16
"""How long a report takes is known from the fastest one of this number of images."""

MISSING = 2
"""Where the reports of more images than this are overdue, nothing is predicted from what is on its way: the link may be
cut."""

LASTING = 2.0
"""The gain of a reference on its way counts this many times, as the images after the next one gain, too. Clips of
`experiments video` at 0, 20, 50 % lost, 0.3 Mbit/s: euroc 39.1, 36.6, 32.5 dB with what is held only, 39.4, 37.0, 33.0
with 2, 39.4, 37.1, 33.1 with 3. Thermal at 1 Mbit/s, 20 %: 43.5, but with 3 43.2."""

LEAST_ERROR = 0.05
"""Mean squared errors much below are not distinguished [count^2]."""


class Prediction(NamedTuple):
    """What an image is coded against."""
    number: int
    """Number of the reference."""
    layers: int
    """Number of the reference's layers that are used."""
    checksum: int
    """Checksum of the reference's pixels, see references.checksum_of."""
    course: bytes
    """Motion since the reference, and since a second one, see blend.to_bytes."""
    pixels: Array
    """The displaced reference, or blend of two: shape and type of the image."""
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
    errors: List[float]
    """Mean squared errors of its layers [count^2]."""
    chances: List[float]
    """How likely each of its layers is restored by who has its reference."""
    reference: Optional[Tuple[int, int]]
    """Number and layers of its reference."""

    def error(self, layers: int) -> float:
        """Mean squared error with this number of its layers, or with all where it has fewer [count^2]."""
        return self.errors[min(layers, len(self.errors)) - 1]


class _MotionFinder:
    """Finds the motion since a reference. Where there was none it is sought again after a while only, or once the
    images differ more: it takes longer than coding does."""

    def __init__(self) -> None:
        self._still: Optional[float] = None     # mean squared difference where there was no motion [count^2]
        self._skipped = 0

    def find(self, reference: Array, pixels: Array) -> motion.Motion:
        """The motion from a reference to an image."""
        difference = differences.mean_square(reference, pixels, SAMPLED)
        if self._still is not None and difference <= MOVED * self._still and self._skipped < SKIPPED:
            self._skipped += 1
            return motion.NONE
        found = motion.estimate(reference, pixels)
        self._still, self._skipped = None if found else difference, 0
        return found


class _Gain:
    """Whether the next image is worth predicting, after what the last predictions saved."""

    def __init__(self) -> None:
        self._poor = 0      # predictions in a row that saved little
        self._skipped = 0

    def add(self, saved: float) -> None:
        """A prediction saved this part of the bits."""
        self._poor, self._skipped = self._poor + 1 if saved < SAVES else 0, 0

    def expected(self) -> bool:
        """Whether the next image is predicted; to be asked once an image."""
        if self._poor >= 2 and self._skipped < PAUSE:
            self._skipped += 1
            return False
        return True


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
        """Session and number of the next image."""
        self._references.clear()
        self._sent: Dict[int, _Sent] = {}
        self._lags: Deque[int] = deque(maxlen=LAGS)     # from images to the newest one that is held
        self._motion, self._gain, self._second_gain = _MotionFinder(), _Gain(), _Gain()
        self._excess = 0.0      # of the last prediction's error over that of its reference [count^2]
        self._refined = 0.0     # logarithm of what the last image's coding made of its prediction's error

    def worth_trying(self, repeated: int) -> bool:
        """Whether to predict the next image; to be asked once an image.

        :param repeated: as in `predict`
        """
        return repeated > 0 or self._gain.expected()

    def predict(self, pixels: Array, stamp: float, growth: float, names: Collection[str], now: float,
                repeated: int = 0) -> Optional[Prediction]:
        """What the next image is to be coded against; None: nothing that all operators hold is like it.

        :param pixels: of the next image, as the codec takes them
        :param stamp: its time [s]
        :param growth: of the mean squared difference between images with time, see freshness.MotionMeter [count^2/s]
        :param names: of the operators that it is sent to
        :param now: by a steady clock [s]
        :param repeated: how many images in a row, up to the next one, show what the one before did
        """
        held = self._held.layers(names, self.session, self._references.layers(self.session), now)
        if not held:
            return None
        number, layers = self._best(held, stamp, growth)
        reference = self._references.get((self.session, number), layers, shape_of(pixels))
        if reference is None:
            return None
        same = self.number - number <= repeated
        other = None if same or not self._second_gain.expected() else self._second(held, number, stamp, growth)
        if number in held:      # those before are never used again
            self._references.forget_before((self.session, min(number, other[0]) if other else number))
        moved = motion.NONE if same else self._motion.find(reference.pixels, pixels)
        displaced, course = motion.compensate(reference.pixels, moved), blend.Course(moved, None)
        if other:
            displaced, course = self._blended(displaced, moved, *other, pixels)
            if number in held or course.second:     # beside an image on its way one may be of no use, but later again
                self._second_gain.add(float(course.second is not None))
        found = _prediction(number, layers, reference.checksum, blend.to_bytes(course), displaced, pixels)
        if same:        # better known than before: else it might seem best for ever
            self._sent[number].errors[layers - 1] = found.error
        return found

    def _best(self, held: Mapping[int, int], stamp: float, growth: float) -> Tuple[int, int]:
        """Number and layers of the reference: the held image that is most like the next one, or one on its way.

        Errors are compared by their logarithms. If the operator lacks a reference on its way, it goes on showing about
        what is held, and misses what the next image adds.
        """
        def error(image: Tuple[int, int]) -> float:
            return self._distance(*image, stamp, growth)
        found = _least(held, error)
        own, most = self._left(*found), 0.0
        lost = max(_log(error(found)) - own, 0.0) + self._refined
        for image, chance in self._coming(held).items():
            gain = LASTING * chance * (own - self._left(*image)) - (1 - chance) * lost
            if gain > most:
                found, most = image, gain
        return found

    def _left(self, number: int, layers: int) -> float:
        """The logarithm of what a reference leaves to be coded, about: displaced, it differs by more than its error."""
        return _log(self._sent[number].error(layers) + self._excess)

    def _second(self, held: Mapping[int, int], first: int, stamp: float, growth: float) -> Optional[Tuple[int, int]]:
        """Number and layers of the image that is most like the next one beside the first reference; None: none is held.
        """
        others = {number: layers for number, layers in held.items() if number != first}
        return _least(others, lambda image: self._distance(*image, stamp, growth)) if others else None

    def _blended(self, displaced: Array, moved: motion.Motion, number: int, layers: int, pixels: Array
                 ) -> Tuple[Array, blend.Course]:
        """The displaced reference and its motion, blended with a second one if that makes it more like the next image.

        :param number, layers: of the second one
        """
        alone = displaced, blend.Course(moved, None)
        second = self._references.get((self.session, number), layers, shape_of(pixels))
        if second is None:
            return alone
        its_motion = motion.estimate(second.pixels, pixels) if moved else motion.NONE
        other = motion.compensate(second.pixels, its_motion)
        share = blend.share_of(displaced, other, pixels)
        if not share:
            return alone
        return blend.blended(displaced, other, share), blend.Course(
            moved, blend.Second(self.number - number, layers, second.checksum, share, its_motion))

    def _coming(self, held: Mapping[int, int]) -> Dict[Tuple[int, int], float]:
        """{number and layers of images whose reports cannot have come yet: how likely an operator holds them}; none
        where the reports before are missing, too."""
        self._lags.append(self.number - max(held))
        lag, found = min(self._lags), {}        # type: int, Dict[Tuple[int, int], float]
        if self._lags[-1] > lag + MISSING:
            return found
        for number in range(self.number - lag + 1, self.number):
            sent = self._sent.get(number)
            if sent is None or number in held:
                continue
            before, layers = sent.reference or (number, 0)
            chance = 1.0 if held.get(before, 0) >= layers else found.get((before, layers), 0.0)
            if chance:
                found.update({(number, layer): chance * own for layer, own in enumerate(sent.chances, 1)})
        return found

    def saved(self, part: float) -> None:
        """The prediction of the next image saves this part of its bits."""
        self._gain.add(part)

    def describe(self, records: Records, prediction: Optional[Prediction]) -> None:
        """Write into the segments of the next image which one it is, and its reference."""
        records['session'], records['picture'] = self.session, self.number
        if prediction is None:
            records['reference'], records['reference_layers'], records['checksum'] = self.number, 0, 0
        else:
            records['reference'], records['reference_layers'] = prediction.number, prediction.layers
            records['checksum'] = prediction.checksum

    def sent(self, image: CodedImage, errors: Sequence[float], chances: Sequence[float],
             prediction: Optional[Prediction], stamp: float, names: Collection[str], now: float) -> None:
        """The next image leaves.

        :param errors: mean squared errors once each of its layers is restored, about [count^2]
        :param chances: how likely each of them is restored by who has its reference
        """
        # no layer makes an image worse than its prediction is, whose error is known better
        most = math.inf if prediction is None else prediction.error
        if prediction is not None:
            self._excess = max(prediction.error - self._sent[prediction.number].error(prediction.layers), 0.0)
            self._refined = max(_log(prediction.error) - _log(errors[-1]), 0.0)
        self._references.add((self.session, self.number), image)
        kept = self._references.layers(self.session)
        self._sent = {number: sent for number, sent in self._sent.items() if number in kept}
        self._sent[self.number] = _Sent(stamp, [min(error, most) for error in errors], list(chances),
                                        prediction and (prediction.number, prediction.layers))
        self.number += 1
        self._held.sent(names, prediction is not None, now)

    def withdraw(self) -> None:
        """The next image takes the place of the last one, which has not left, and is not predicted from it."""
        if self.number - 1 in self._sent:
            self._sent[self.number - 1].chances.clear()

    def _distance(self, number: int, layers: int, stamp: float, growth: float) -> float:
        """The mean squared difference of a reference from the scene, about [count^2]."""
        sent = self._sent[number]
        layers = min(layers, len(sent.errors))
        return sent.errors[layers - 1] + growth * abs(stamp - sent.stamp)


def _log(error: float) -> float:
    return math.log(error + LEAST_ERROR)


def _least(layers: Mapping[int, int], error: Callable[[Tuple[int, int]], float]) -> Tuple[int, int]:
    """Number and layers of the image with the least error, the newest of several."""
    return min(sorted(layers.items(), reverse=True), key=error)


def _prediction(number: int, layers: int, checksum: int, course: bytes, displaced: Array,
                pixels: Array) -> Prediction:
    error = differences.mean_square(pixels, displaced)
    size = differences.entropy(pixels, displaced, SAMPLED if pixels.size > LARGE else 1)
    return Prediction(number, layers, checksum, course, displaced, error, size)
