# SPDX-License-Identifier: BSD-3-Clause
"""Images in layers: an embedded stream, protected so that any of its datagrams show the image (doc/layered_images.md).

Importing this module loads the compiled codec.
"""
import math
from typing import Any, Callable, Collection, List, NamedTuple, Optional, Tuple

import numpy as np

from ...arrays import FloatArray, IntArray, UInt8Array
from ...codecs.layered import image, quality
from ...codecs.layered.pieces import MAX_LAYERS, Plan, protect
from ...codecs.layered.plan import LAYER_BYTES, MOST_LOSS, best_plan, sure_size, worth
from ...codecs.layered.survival import survival
from ...mission.settings import Settings
from ...msg import LayeredSegment
from ...udpros.datagram import IP_UDP_HEADERS
from ...udpros.frame import Frame
from ..encoder import LinkView
from ..outlook import Outlook
from ..segments import LAYERS, as_bytes, room, write_header
from .coding import Coded, CompressedImages
from .coding_time import CodingTime
from .freshness import MotionMeter, Repeats
from .held_by_all import HeldByAll
from .image_size import GOOD_ERROR, LEAST_BYTES, MORE, SPARE, Bound, Costs, Grant, age_cost, choose, period_of
from .pixel_layers import Layerable, layerable, shape_of
from .prediction import SAVES, Prediction, Predictor
from .references import CodedImage, ends_of, with_motion

FLOOR = 255.0 ** 2 / 1e6
"""Mean squared errors of 8 bits below this are not distinguished: 60 dB [count^2]."""

TABLE = LAYER_BYTES * MAX_LAYERS // 2
"""Length of a datagram's table of layers, about [byte]."""

LEAST_PIECES = 128
"""Beside however long texts [byte]."""

RESERVE = 0.85
"""A complete image is protected against losses that are not exceeded with this probability."""

UNIFORM_ERROR = 12 ** -0.5
"""Rms error of values rounded to counts. The exact stream is as long as the other one is up to this error, within 5 %.
Each bit a value halves the error [count]."""

FAIR_BITS = 0.25
"""Size of a fair image: 28 dB of photographs of 320 x 240 pixels [bit per value]."""

CERTAIN_FIT, LIKELY = 0.97, 0.7
"""The exact transform is used where the whole stream is estimated to fill this part, at most, of what arrives of the
budget at losses that are not exceeded with that probability."""

LUCKY, LUCKIER = 0.1, 1.1
"""No more is coded than this many times what arrives of the budget at losses that are exceeded unless with that
probability."""


class LayeredImages(CompressedImages):
    """Encodes images, and estimates what a complete one takes. `encode` is called by one thread, the others by any.

    :param held: what the operators report
    :param session: makes random numbers, uint32
    :param clock: steady [s]
    """
    CODING = 'layered'

    def __init__(self, held: HeldByAll, session: Callable[[], int], clock: Callable[[], float] = lambda: 0.0) -> None:
        super().__init__()
        self._clock, self._time = clock, CodingTime()
        self._error = math.inf                      # rms error of the last image of a scene [count]
        self._foreseen = math.inf                   # no more is coded of the next image of a scene that moves [byte]
        self._predictor = Predictor(session, held)
        self._stream_size: Optional[float] = None   # of a complete stream of an image like the last one [byte]
        self._was_predicted = False                 # whether the last one was, and that saved much
        self._shape: Tuple[Any, ...] = ()           # what it depends on
        self._motion, self._repeats = MotionMeter(), Repeats()

    def backlog(self, link: LinkView) -> Optional[float]:
        return 0.0 if link.unsent else super().backlog(link)

    def encode(self, message: Any, settings: Settings, link: LinkView, granted: Grant, began: float) -> Coded:
        if link.unsent:
            self._predictor.withdraw()
        job = self._job(message, settings, link, granted, began)
        found = self._compressed(job, settings)
        chosen = self._chosen(job, found)
        frame, base = self._protected(job, found, chosen, settings)
        self._time.done(self._clock() - began)
        self.coding_time = self._time.image
        return Coded([frame], chosen.bound, self._error, base)

    def _job(self, message: Any, settings: Settings, link: LinkView, granted: Grant, began: float) -> '_Job':
        """The image, how fast it becomes outdated, and what it may take."""
        source, stamp = layerable(message, settings['scale'], settings['depth_unit']), message.header.stamp.to_sec()
        self._forget_others(source, settings)
        self._repeats.add(source.pixels, source.classes)
        self._motion.add(source.pixels, stamp, source.classes)
        growth = 0.0 if granted.bound is Bound.AIR_TIME else self._motion.growth
        texts = message.header.frame_id.encode(), source.encoding.encode()
        datagrams = Datagrams.of(link.datagram_size, room(LayeredSegment, link.datagram_size, *texts))
        # no image takes more than its pixels, but for what it is protected by
        most = source.pixels.nbytes * datagrams.protected(link.outlook.loss(RESERVE))
        granted = granted._replace(size=max(min(granted.size, most), datagrams.least))
        return _Job(message, source, stamp, texts, growth, period_of(link.frame_rate(settings)), datagrams, granted,
                    link.outlook, link.operators(LAYERS), began)

    def _compressed(self, job: '_Job', settings: Settings) -> '_Compressed':
        """The stream of an image, predicted where that saves anything."""
        prediction = self._predicted(job)
        stream, useful = self._stream(job, prediction, settings)
        if prediction is not None:
            self._predictor.saved(stream.saved)
        good = np.flatnonzero(stream.errors <= _error_of(settings['max_quality'], job.itemsize) * stream.cells)
        stop = int(good[0]) + 1 if len(good) else len(stream.ends)
        self._estimate(job, stream, int(stream.ends[stop - 1]))
        return _Compressed(stream, prediction if stream.predicted else None, useful, stop)

    def _chosen(self, job: '_Job', found: '_Compressed') -> '_Chosen':
        """How much of a stream is sent, and what that may take."""
        stream, granted, outlook = found.stream, job.granted, job.outlook
        ends = stream.ends[:found.good]
        costs = Costs(job.datagrams.protected(outlook.loss(LIKELY)), self._time.per_byte, outlook.room * outlook.gain(),
                      outlook.tokens())
        points, square = choose(ends, np.maximum(stream.errors[:found.good], 0) / stream.cells, stream.cells,
                                job.growth, job.period, costs, GOOD_ERROR if job.itemsize == 1 else 0.0)
        self._error = math.sqrt(square)
        bound = _bound_of(found, points, granted)
        needed = float(ends[points - 1])
        self._foreseen = needed * {Bound.FRESHNESS: SPARE, Bound.CODING: MORE}.get(bound, math.inf)
        budget = granted.size
        if bound is not granted.bound:
            protected = needed / CERTAIN_FIT * job.datagrams.protected(outlook.loss(RESERVE))
            sure = sure_size(outlook.air.losses, outlook.air.burst, job.datagrams.head)
            budget = max(min(budget, max(protected, sure)), job.datagrams.least)
        return _Chosen(points, bound, int(budget))

    def _protected(self, job: '_Job', found: '_Compressed', chosen: '_Chosen', settings: Settings
                   ) -> Tuple[Frame, int]:
        """The datagrams of an image, and how many of them show something of it."""
        stream, prediction, air = found.stream.cut(chosen.points), found.prediction, job.outlook.air
        beginning = with_motion(prediction.course, b'') if prediction else b''
        ends, errors = found.stream.ends[:chosen.points] + len(beginning), found.stream.errors[:chosen.points]
        floor = None if job.itemsize > 1 else max(FLOOR, _error_of(settings['max_quality'], 1))
        plan = best_plan(ends, worth(errors, stream.cells, floor), chosen.budget, air.losses, air.burst,
                         job.datagrams.head, job.datagrams.room)
        layer_errors = _layer_errors(plan, ends, errors, stream.cells)
        frame = _frame(job, plan, protect(beginning + stream.data, plan), layer_errors)
        self._predictor.describe(frame.records, prediction)
        coded = CodedImage(shape_of(job.source.pixels), stream.prefixes,
                           [end - len(beginning) for end in ends_of(plan.layers, plan.count)])
        known = _in_proportion(layer_errors, float(errors[0]) / stream.cells, prediction)
        self._predictor.sent(coded, known, _chances(plan, job.outlook), prediction, job.stamp, job.operators, job.began)
        return frame, plan.layers[0].threshold

    def _predicted(self, job: '_Job') -> Optional[Prediction]:
        """What the image is to be coded against; None: nothing, or to predict it takes so long that the scene has moved
        by more than that could save, or the last predictions saved little."""
        if (age_cost(job.growth) * self._time.prediction > self._error ** 2
                or not self._predictor.worth_trying(self._repeats.count)):
            return None
        began = self._clock()
        prediction = self._predictor.predict(job.source.pixels, job.stamp, self._motion.growth, job.operators,
                                             job.began, self._repeats.count)
        self._time.predicted(self._clock() - began)
        return prediction

    def _forget_others(self, source: Layerable, settings: Settings) -> None:
        """Forget what was measured of images of another kind."""
        shape = (source.pixels.shape, source.encoding, source.depth_unit, settings['scale'], settings['max_quality'])
        if shape != self._shape:
            self._shape, self._stream_size, self._motion = shape, None, MotionMeter()
            self._foreseen = self._error = math.inf
            self._predictor.begin()

    def _stream(self, job: '_Job', prediction: Optional[Prediction], settings: Settings
                ) -> Tuple[image.LayeredStream, int]:
        """The stream of an image, exact where all of it is likely to arrive, and how long a useful one is, at most."""
        if prediction is not None:
            size: Optional[float] = prediction.exact_size
        else:
            size = None if self._was_predicted else self._stream_size
        source, loss, carried = job.source, job.outlook.loss, job.datagrams.carried(job.granted.size)
        useful = max(int(min(1.0, LUCKIER * (1 - loss(LUCKY))) * carried), LEAST_BYTES)
        coded = max(int(min(useful, self._foreseen * job.outlook.gain())), LEAST_BYTES) if job.growth else useful
        fits = size is not None and size <= min(CERTAIN_FIT * carried * (1 - loss(LIKELY)), coded)
        # while images are repeated the exact transform refines them: the coefficients that one image leaves are what
        # the next one codes, as its analysis undoes its synthesis exactly
        refining = prediction is not None and self._repeats.count > 0
        lossless = not settings['max_quality'] and (fits or refining)
        began = self._clock()
        stream = image.encode(source.pixels, lossless, coded, source.classes, prediction and prediction.pixels)
        self._time.coded(stream.cells, len(stream.data), self._clock() - began)
        return stream, useful

    def _estimate(self, job: '_Job', stream: image.LayeredStream, useful: int) -> None:
        """Estimate the size of a complete image.

        :param useful: what is useful of its stream [byte]
        """
        size = _complete(stream, useful)
        # one that saves little is like none: the images after it are coded without
        self._stream_size, self._was_predicted = size / (1 - stream.saved), stream.saved >= SAVES
        protected = job.datagrams.protected(job.outlook.loss(RESERVE))
        self._fair_size = FAIR_BITS / 8 * stream.cells * protected
        self._note_size(min(size / CERTAIN_FIT, job.source.pixels.nbytes) * protected)


class Datagrams(NamedTuple):
    """What the datagrams of an image hold."""
    head: int
    """Size of each datagram on the air, with an empty table of layers and no pieces [byte]."""
    room: int
    """Room in each datagram for its table and pieces [byte]."""

    @classmethod
    def of(cls, max_size: int, free: int) -> 'Datagrams':
        """:param max_size, free: of a datagram, and what it leaves for table and pieces [byte of UDP payload]"""
        return cls(max_size + IP_UDP_HEADERS - free, free)

    @property
    def least(self) -> int:
        """An image takes this on the air, at least [byte]."""
        return max(LEAST_BYTES, self.head + LEAST_PIECES)

    def carried(self, size: float) -> float:
        """The pieces in this size on the air [byte]."""
        return size / self.protected(0.0)

    def protected(self, loss: float) -> float:
        """Bytes on the air of a byte of the stream that is protected against a packet loss."""
        overhead = (self.head + TABLE) / max(self.room - TABLE, 1)
        return (1 + overhead) / max(1 - loss, 1 - MOST_LOSS)


class _Job(NamedTuple):
    """An image to be coded."""
    message: Any
    """sensor_msgs/Image."""
    source: Layerable
    stamp: float
    """[s]"""
    texts: Tuple[bytes, bytes]
    """frame_id and encoding."""
    growth: float
    """Growth of its mean squared error with its age; 0: its size does not depend on that [count^2/s]."""
    period: float
    """Time until the next one [s]."""
    datagrams: Datagrams
    granted: Grant
    outlook: Outlook
    operators: Collection[str]
    """Names of those that it is sent to."""
    began: float
    """When its coding began, by a steady clock [s]."""

    @property
    def itemsize(self) -> int:
        """Size of a value [byte]."""
        return int(self.source.pixels.itemsize)


class _Compressed(NamedTuple):
    """What an image was coded into."""
    stream: image.LayeredStream
    prediction: Optional[Prediction]
    useful: int
    """No longer stream would have been of use [byte]."""
    good: int
    """With so many truncation points it is as good as max_quality demands, or that are all."""


class _Chosen(NamedTuple):
    """What is sent of a stream."""
    points: int
    """Truncation points."""
    bound: Bound
    """What decided it."""
    budget: int
    """What that may take on the air [byte]."""


def _bound_of(found: _Compressed, points: int, granted: Grant) -> Bound:
    """What decided that so many truncation points of a stream are sent."""
    stream = found.stream
    if points < found.good:
        return Bound.FRESHNESS
    if found.good < len(stream.ends):
        return Bound.MAX_QUALITY
    if stream.errors[-1] == 0:
        return Bound.EXACT
    return Bound.CODING if len(stream.data) < found.useful else granted.bound


def _in_proportion(errors: List[float], first: float, prediction: Optional[Prediction]) -> List[float]:
    """The estimated mean squared errors of layers, changed as that of the prediction alone differs from its true one.

    :param first: that of the prediction alone, as estimated
    """
    if prediction is None or first <= prediction.error:
        return errors
    return [error * prediction.error / first for error in errors]


def _chances(plan: Plan, outlook: Outlook) -> List[float]:
    """How likely each layer of an image is restored."""
    restored = survival(plan.count, outlook.air.losses, outlook.air.burst)
    return [float(restored[layer.threshold - 1]) for layer in plan.layers]


def _complete(stream: image.LayeredStream, useful: int) -> float:
    """The estimated length of a complete stream [byte].

    :param useful: what is useful of this one [byte]
    """
    variances = np.maximum(stream.errors, 0) / stream.cells
    fine = np.flatnonzero(variances <= UNIFORM_ERROR ** 2)
    if len(fine) and variances[-1] > 0:
        useful = min(useful, int(stream.ends[fine[0]]))
    elif not len(fine) and useful == len(stream.data):
        useful += int(stream.cells * math.log2(math.sqrt(variances[-1]) / UNIFORM_ERROR) / 8)
    return float(useful + stream.missing)


def _error_of(max_quality: float, itemsize: int) -> float:
    """The mean squared error of a PSNR [count^2]; 0 for max_quality 0, which is exact.

    :param max_quality: [dB]
    """
    peak = 256.0 ** itemsize - 1
    return peak ** 2 / 10 ** (max_quality / 10) if max_quality else 0.0


def _layer_errors(plan: Plan, ends: IntArray, errors: FloatArray, cells: int) -> List[float]:
    """The mean squared error of the image once each layer is restored [count^2]."""
    points = np.maximum(np.searchsorted(ends, ends_of(plan.layers, plan.count), 'right') - 1, 0)
    found: List[float] = (np.maximum(errors[points], 0) / cells).tolist()
    return found


def _frame(job: _Job, plan: Plan, pieces: UInt8Array, errors: List[float]) -> Frame:
    """The datagrams of an image; what they say about its reference is still missing.

    :param pieces: (count, s) uint8
    :param errors: mean squared errors once each layer is restored [count^2]
    """
    message, source, texts, layers = job.message, job.source, job.texts, len(plan.layers)
    frame = Frame(LayeredSegment, plan.count, {
        'header.frame_id': len(texts[0]), 'encoding': len(texts[1]), 'thresholds': layers, 'sizes': layers,
        'errors': layers, 'data': pieces.shape[1]})
    records = frame.records
    write_header(records, message.header)
    records['height'], records['width'] = source.pixels.shape[:2]
    records['encoding'], records['is_bigendian'] = as_bytes(texts[1]), bool(message.is_bigendian)
    records['depth_unit'] = source.depth_unit
    records['index'], records['count'] = np.arange(plan.count), plan.count
    records['thresholds'] = [layer.threshold for layer in plan.layers]
    records['sizes'] = [layer.size for layer in plan.layers]
    records['errors'] = [quality.to_byte(math.sqrt(error)) for error in errors]
    records['data'] = pieces
    return frame
