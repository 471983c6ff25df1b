# SPDX-License-Identifier: BSD-3-Clause
"""Images in layers: an embedded stream, protected so that any of its datagrams show the image (doc/layered_images.md).

Importing this module loads the compiled codec.
"""
import math
from typing import Any, Callable, Collection, List, Optional, Tuple

import numpy as np

from ...arrays import FloatArray, IntArray, UInt8Array
from ...codecs.layered import image, quality
from ...codecs.layered.pieces import MAX_LAYERS, Plan, protect
from ...codecs.layered.plan import LAYER_BYTES, best_plan, worth
from ...codecs.layered.survival import survival
from ...mission.settings import Settings
from ...msg import LayeredSegment
from ...udpros.datagram import IP_UDP_HEADERS
from ...udpros.frame import Frame
from ..outlook import Outlook
from ..segments import as_bytes, room, write_header
from .coded_shape import shape_of
from .coding_time import CodingTime, Foreseen
from .compressed_images import LEAST_BYTES, CompressedImages
from .freshness import MotionMeter, Repeats, contrast_of, worth_sending
from .held_by_all import HeldByAll
from .pixel_layers import Layerable, layerable
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

LEAST_ROOM = 1.0
"""A stream that may use less of the link counts as if it could use this [byte/s]."""

LEAST_DURATION = 1e-9
"""A byte takes at least this long [s]."""

MOST_LOSS = 0.99
"""Against heavier losses an image is protected as against this packet-loss ratio."""

UNIFORM_ERROR = 12 ** -0.5
"""Rms error of values rounded to counts. The exact stream is as long as the other one is up to this error, within 5 %.
Each bit a value halves the error [count]."""

FAIR_BITS = 0.25
"""Of a fair image: 28 dB of photographs of 320 x 240 pixels [bit per value]."""

GOOD = 255.0 / 10 ** (42 / 20)
"""Rms error of a good image of 8 bits: 42 dB [count]."""

GOOD_BITS = 2.0
"""A good image takes less, mostly [bit per value]."""

CERTAIN_FIT, LIKELY = 0.97, 0.7
"""The exact transform is used where the whole stream is estimated to fill this part, at most, of what arrives of the
budget at losses that are not exceeded with that probability."""

PROTECTION_TIME = 0.002
"""An image that is short for the sake of the processors' time may take this time more on the air, for its protection
[s]."""

LUCKY, MORE = 0.1, 1.1
"""No more is coded than this many times what arrives of the budget at losses that are exceeded unless with that
probability."""

OFTEN = 0.8
"""Layers that are restored with this probability may be predicted from before anybody reports them, while nothing
moves."""


class LayeredImages(CompressedImages):
    """Encodes images, and estimates what a complete one takes. `encode` and `measure` are called by one thread, the
    others by any.

    :param held: what the operators report
    :param session: makes random numbers, uint32
    :param clock: steady [s]
    """
    # images come with jitter, and the rest of one that still waits when the next one comes is never sent
    AIR_PART = 0.8
    BACKLOG = 0.05
    """The rest of an image is waited for this long: without it, the layers of high thresholds are lost [s]."""

    def __init__(self, held: HeldByAll, session: Callable[[], int], clock: Callable[[], float] = lambda: 0.0) -> None:
        super().__init__()
        self._time, self._foreseen = CodingTime(clock), Foreseen()
        self._error = math.inf                      # mean squared error of the last image as sent [count^2]
        self._predictor = Predictor(session, held)
        self._stream_size: Optional[float] = None   # of a complete stream of an image like the last one [byte]
        self._was_predicted = False                 # whether the last one was, and that saved much
        self._shape: Tuple[Any, ...] = ()           # what it depends on
        self.good_size: Optional[float] = None
        """Of an image of GOOD quality on the air, if it has 8 bits; None: unknown [byte]."""
        self._motion, self._repeats = MotionMeter(), Repeats()
        self._shortened = False                     # whether the scene moves too fast for a complete image

    def encode(self, message: Any, settings: Settings, max_datagram_size: int, outlook: Outlook,
               recipients: Tuple[Collection[str], float] = ((), 0.0), large: bool = False) -> List[Frame]:
        """As Encoder.encode.

        :param outlook: what to expect of the link
        :param recipients: names of the operators, and now, by a steady clock [s]
        :param large: whether it takes as much of the link as it may, however old it is then
        """
        source, stamp = layerable(message, settings['scale'], settings['depth_unit']), message.header.stamp.to_sec()
        self._forget_others(source, settings)
        self._repeats.add(source.pixels, source.classes)
        prediction = self._predicted(source, stamp, recipients)
        texts = message.header.frame_id.encode(), source.encoding.encode()
        free = room(LayeredSegment, max_datagram_size, *texts)
        head = max_datagram_size + IP_UDP_HEADERS - free
        overhead = (head + TABLE) / max(free - TABLE, 1)
        least = max(LEAST_BYTES, head + LEAST_PIECES)
        budget = max(self._budget(source, prediction, settings, overhead, outlook), least)
        carried = int(budget / (1 + overhead))
        useful = max(int(min(1.0, MORE * (1 - outlook.loss(LUCKY))) * carried), LEAST_BYTES)
        large = large or settings['air_time'] > 0
        coded = int(max(min(useful, math.inf if large else self._foreseen.size), LEAST_BYTES))
        stream = self._compress(source, prediction, settings, carried, coded, outlook)
        if prediction is not None:
            self._predictor.saved(stream.saved)
        prediction = prediction if stream.predicted else None
        ends, errors = _useful(stream, settings['max_quality'], source.pixels.itemsize)
        floor = None if source.pixels.itemsize > 1 else max(FLOOR, _bound(settings['max_quality'], 1))
        self._estimate(source, prediction, stream, int(ends[-1]), overhead, outlook)
        self.good_size = _length_at(stream, GOOD) * _protected(overhead, outlook.loss(LIKELY))
        self._motion.add(source.pixels, stamp, source.classes)
        hurried = coded < useful
        duration = _protected(overhead, outlook.loss(LIKELY)) / max(outlook.room, LEAST_ROOM) + self._time.per_byte
        fresh = len(ends) if large else worth_sending(ends, errors, self._motion.growth * stream.cells,
                                                      max(duration, LEAST_DURATION), stream.cells,
                                                      contrast_of(source.pixels))
        self._foreseen.sent(int(ends[fresh - 1]), int(ends[-1]), not hurried or len(stream.data) < coded)
        self._shortened = fresh < len(ends) or hurried
        self._error = max(float(errors[fresh - 1]), 0.0) / stream.cells
        if hurried:
            needed = ends[fresh - 1] * _protected(overhead, outlook.loss(RESERVE))
            budget = int(min(budget, needed + PROTECTION_TIME * outlook.room))
        else:
            budget = int(budget * ends[fresh - 1] / ends[-1])
        budget = max(budget, least)
        ends, errors = ends[:fresh] + len(_beginning(prediction)), errors[:fresh]
        plan = best_plan(ends, worth(errors, stream.cells, floor), budget, outlook.air.losses, outlook.air.burst, head,
                         free)
        stream, layer_errors = stream.cut(fresh), _layer_errors(plan, ends, errors, stream.cells)
        frame = _frame(message, source, plan, protect(_beginning(prediction) + stream.data, plan), texts, layer_errors)
        self.base = plan.layers[0].threshold
        self._predictor.describe(frame.records, prediction)
        known = _in_proportion(layer_errors, float(errors[0]) / stream.cells, prediction)
        self._predictor.sent(_coded(source, prediction, stream, plan), known, _likely(plan, outlook), prediction, stamp,
                             *recipients)
        return [frame]

    def measure(self, message: Any, settings: Settings, outlook: Outlook) -> None:
        """Measure `good_size` of an image that is not layered."""
        source = layerable(message, settings['scale'], settings['depth_unit'])
        stream = image.encode(source.pixels, False, int(GOOD_BITS / 8 * source.pixels.size), source.classes)
        self.good_size = _length_at(stream, GOOD) * _protected(0.0, outlook.loss(LIKELY))

    def _predicted(self, source: Layerable, stamp: float,
                   recipients: Tuple[Collection[str], float]) -> Optional[Prediction]:
        """What the image is to be coded against; None: nothing, or to predict it takes so long that the scene has moved
        by more than that could save, or the last predictions saved little."""
        if (self._motion.growth * self._time.prediction > self._error
                or not self._predictor.worth_trying(self._repeats.count)):
            return None
        self._time.begin()
        prediction = self._predictor.predict(source.pixels, stamp, self._motion.growth, *recipients,
                                             self._repeats.count)
        self._time.predicted()
        return prediction

    def _forget_others(self, source: Layerable, settings: Settings) -> None:
        """Forget what was measured of images of another kind."""
        shape = (source.pixels.shape, source.encoding, source.depth_unit, settings['scale'], settings['max_quality'])
        if shape != self._shape:
            self._shape, self._stream_size, self._motion, self._shortened = shape, None, MotionMeter(), False
            self._foreseen, self._error = Foreseen(), math.inf
            self._predictor.begin()

    def _budget(self, source: Layerable, prediction: Optional[Prediction], settings: Settings, overhead: float,
                outlook: Outlook) -> int:
        """What the image may take on the air [byte].

        :param overhead: of the datagrams' heads, relative to what they carry
        """
        whole = source.pixels.nbytes * (1 + overhead)
        if prediction is not None:
            whole = min(whole, prediction.exact_size / CERTAIN_FIT * _protected(overhead, outlook.loss(RESERVE)))
        elif self._stream_size is not None and self._size is not None and not self._was_predicted:
            whole = self._size
        return int(max(min(whole, self.budget(settings, outlook)), LEAST_BYTES))

    def _compress(self, source: Layerable, prediction: Optional[Prediction], settings: Settings, budget: int,
                  coded: int, outlook: Outlook) -> image.LayeredStream:
        """The stream of an image, exact where all of it is likely to arrive.

        :param budget: of the stream on the air [byte]
        :param coded: what is coded of it, at most [byte]
        """
        if prediction is not None:
            size: Optional[float] = prediction.exact_size
        else:
            size = None if self._was_predicted else self._stream_size
        fits = size is not None and size <= CERTAIN_FIT * budget * (1 - outlook.loss(LIKELY))
        # while images are repeated the exact transform refines them: the coefficients that one image leaves are what
        # the next one codes, as its analysis undoes its synthesis exactly
        refining = prediction is not None and self._repeats.count > 0
        lossless = not settings['max_quality'] and not self._shortened and (fits or refining)
        self._time.begin()
        stream = image.encode(source.pixels, lossless, coded, source.classes, prediction and prediction.pixels)
        self._time.coded(stream.cells, len(stream.data))
        return stream

    def _estimate(self, source: Layerable, prediction: Optional[Prediction], stream: image.LayeredStream, useful: int,
                  overhead: float, outlook: Outlook) -> None:
        """Estimate the size of a complete image."""
        size = _complete(stream, useful, prediction and prediction.exact_size)
        # one that saves little is like none: the images after it are coded without
        self._stream_size, self._was_predicted = size / (1 - stream.saved), stream.saved >= SAVES
        protected = _protected(overhead, outlook.loss(RESERVE))
        self._fair_size = FAIR_BITS / 8 * stream.cells * protected
        on_air = min(size / CERTAIN_FIT * protected, source.pixels.nbytes * (1 + overhead))
        self._note_size(on_air)


def _beginning(prediction: Optional[Prediction]) -> bytes:
    """What is before the codec's stream."""
    return with_motion(prediction.motion, b'') if prediction else b''


def _in_proportion(errors: List[float], first: float, prediction: Optional[Prediction]) -> List[float]:
    """The estimated mean squared errors of layers, changed as that of the prediction alone differs from its true one.

    :param first: that of the prediction alone, as estimated
    """
    if prediction is None or first <= prediction.error:
        return errors
    return [error * prediction.error / first for error in errors]


def _likely(plan: Plan, outlook: Outlook) -> int:
    """How many layers of an image are restored with the probability OFTEN, at least."""
    restored = survival(plan.count, outlook.air.losses, outlook.air.burst)
    return sum(bool(restored[layer.threshold - 1] >= OFTEN) for layer in plan.layers)


def _coded(source: Layerable, prediction: Optional[Prediction], stream: image.LayeredStream, plan: Plan) -> CodedImage:
    """An image as its receivers get it."""
    before = len(_beginning(prediction))
    return CodedImage(shape_of(source.pixels), stream.prefixes,
                      [end - before for end in ends_of(plan.layers, plan.count)])


def _complete(stream: image.LayeredStream, useful: int, exact: Optional[float]) -> float:
    """The estimated length of a complete stream [byte].

    :param useful: what is useful of this one [byte]
    :param exact: of a predicted image, see Prediction.exact_size
    """
    if useful < len(stream.data) or stream.errors[-1] == 0:
        return float(useful + stream.missing)
    if exact is not None and stream.errors[-1] <= UNIFORM_ERROR ** 2 * stream.cells:
        return max(useful, exact) + stream.missing
    return _length_at(stream, UNIFORM_ERROR) + stream.missing


def _length_at(stream: image.LayeredStream, error: float) -> float:
    """The length of a stream with this rms error, estimated where it is longer [byte]."""
    variances = np.maximum(stream.errors, 0) / stream.cells
    fine = np.flatnonzero(variances <= error ** 2)
    if len(fine):
        return float(stream.ends[fine[0]])
    return float(stream.ends[-1] + stream.cells * max(math.log2(math.sqrt(float(variances[-1])) / error), 0.0) / 8)


def _protected(overhead: float, loss: float) -> float:
    """Bytes on the air of one of the stream."""
    return (1 + overhead) / max(1 - loss, 1 - MOST_LOSS)


def _bound(max_quality: float, itemsize: int) -> float:
    """The mean squared error of a PSNR [count^2]; 0 for max_quality 0, which is exact.

    :param max_quality: [dB]
    """
    peak = 256.0 ** itemsize - 1
    return peak ** 2 / 10 ** (max_quality / 10) if max_quality else 0.0


def _useful(stream: image.LayeredStream, max_quality: float, itemsize: int) -> Tuple[IntArray, FloatArray]:
    """(ends, errors) of the stream up to the first one that is good enough."""
    good = np.flatnonzero(stream.errors <= _bound(max_quality, itemsize) * stream.cells)
    stop = int(good[0]) + 1 if len(good) else len(stream.ends)
    return stream.ends[:stop], stream.errors[:stop]


def _layer_errors(plan: Plan, ends: IntArray, errors: FloatArray, cells: int) -> List[float]:
    """The mean squared error of the image once each layer is restored [count^2]."""
    points = np.maximum(np.searchsorted(ends, ends_of(plan.layers, plan.count), 'right') - 1, 0)
    found: List[float] = (np.maximum(errors[points], 0) / cells).tolist()
    return found


def _frame(message: Any, source: Layerable, plan: Plan, pieces: UInt8Array, texts: Tuple[bytes, bytes],
           errors: List[float]) -> Frame:
    """The datagrams of an image; what they say about its reference is still missing.

    :param pieces: (count, s) uint8
    :param texts: frame_id and encoding
    :param errors: mean squared errors once each layer is restored [count^2]
    """
    layers = len(plan.layers)
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
