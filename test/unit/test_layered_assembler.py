# SPDX-License-Identifier: BSD-3-Clause
"""Images in layers on the operator's side: which image is made of which datagrams, and what bad ones cost."""
import math
import subprocess
import sys
import threading
import tracemalloc
from types import SimpleNamespace
from typing import Any, Dict, List, Sequence, Tuple

import needs_numba  # noqa: F401
import numpy as np
import pytest
from genpy import Time
from sensor_msgs.msg import Image

from evaluation.offline_link import MAX_DATAGRAM_SIZE, Sender, operator_side
from smokebot_udp.codecs.layered.depth import to_counts
from smokebot_udp.codecs.layered.image import encode
from smokebot_udp.codecs.layered.pieces import Layer, Plan, protect
from smokebot_udp.codecs.layered.quality import from_byte
from smokebot_udp.codecs.wire.partial_image import MAX_IMAGE_SIZE
from smokebot_udp.image_error import ImageError
from smokebot_udp.mission.parameters import check
from smokebot_udp.mission.settings import Settings
from smokebot_udp.msg import LayeredSegment
from smokebot_udp.streams.air import Air
from smokebot_udp.streams.frame_assembler import QUIET
from smokebot_udp.streams.image.assembled import RestoredImage
from smokebot_udp.streams.image.encoder import ImageEncoder
from smokebot_udp.streams.image.layered import LayeredImage
from smokebot_udp.streams.image.size_guard import FIRST, PROOF, SizeGuard
from smokebot_udp.streams.outlook import Outlook
from smokebot_udp.streams.segments import LAYERS, MAIN_PART, size_on_air
from smokebot_udp.udpros.frame import Frame

COUNT = 12
THRESHOLDS = 1, 4, 9
"""Of the layers of an image of `segments`: any datagram shows it, 9 of the 12 complete it."""

ERRORS = 200, 100, 0


def scene(seed: int = 0, dtype: Any = np.uint16, shape: Tuple[int, ...] = (48, 64)) -> Any:
    """A smooth image with noise, so that a lossless stream has several hundred bytes."""
    rows, columns = np.mgrid[:shape[0], :shape[1]]
    smooth = 100 + 50 * np.sin((rows + seed) / 9.0) + 40 * np.cos(columns / 7.0)
    if len(shape) == 3:
        smooth = smooth[..., np.newaxis] + np.arange(3) * 5
    noise = np.random.RandomState(seed).randint(0, 3, shape)
    return (smooth * (1 if dtype == np.uint8 else 60) + noise).clip(0, np.iinfo(dtype).max).astype(dtype)


def layers_of(size: int) -> List[Layer]:
    """Layers that hold a stream: 60 bytes, 300 bytes, the rest."""
    return [Layer(1, 60), Layer(4, 75), Layer(9, max(-(-(size - 360) // 9), 1))]


def segments(pixels: Any, seconds: int, encoding: str = 'mono16', classes: Any = None, depth_unit: float = 0.0,
             is_bigendian: bool = False) -> Any:
    """(12,) records of an image."""
    stream = encode(pixels, True, 1 << 20, classes)
    layers = layers_of(len(stream.data))
    pieces = protect(stream.data, Plan(COUNT, layers))
    frame = Frame(LayeredSegment, COUNT, {
        'header.frame_id': 6, 'encoding': len(encoding), 'thresholds': 3, 'sizes': 3, 'errors': 3,
        'data': pieces.shape[1]})
    records = frame.records
    records['header']['stamp']['secs'], records['header']['stamp']['nsecs'] = seconds, 5
    records['header']['frame_id'] = np.frombuffer(b'camera', np.uint8)
    records['height'], records['width'] = pixels.shape[:2]
    records['encoding'] = np.frombuffer(encoding.encode(), np.uint8)
    records['is_bigendian'], records['depth_unit'] = is_bigendian, depth_unit
    records['index'], records['count'] = np.arange(COUNT), COUNT
    records['thresholds'], records['sizes'] = THRESHOLDS, [layer.size for layer in layers]
    records['errors'], records['data'] = ERRORS, pieces
    return records


class Operator:
    """An assembler and what it publishes."""

    def __init__(self, **settings: Any) -> None:
        self.assembler, self.settings = operator_side('image', **settings)

    def __call__(self, records: Any, now: float, part: str = LAYERS) -> List[Any]:
        """What is published at once of some segments."""
        self.assembler.receive(records, np.ones(len(records), bool), now, part)
        return self.poll(now)

    def poll(self, now: float) -> List[Any]:
        results = []
        finished = self.assembler.poll(now)
        while finished is not None:
            assembled = self.assembler.assemble(finished, self.settings, False, now)
            if assembled is not None:
                self.assembler.settle(finished, assembled, self.settings, now)
                results.append(assembled)
            finished = self.assembler.poll(now)
        return results

    @property
    def dropped(self) -> Dict[str, int]:
        return {reason: count for reason, count in self.assembler.dropped.items() if count}


def pixels_of(assembled: Any, dtype: Any = np.uint16) -> Any:
    message = assembled.message
    return np.frombuffer(message.data, dtype).reshape(message.height, message.width, -1).squeeze()


def rms(first: Any, second: Any) -> float:
    return float(np.sqrt(np.mean((first.astype(float) - second) ** 2)))


@pytest.mark.parametrize('came', [range(9), range(3, 12), [11, 0, 7, 3, 5, 9, 2, 4, 8]])
def test_enough_datagrams_make_the_exact_image_at_once(came: Sequence[int]) -> None:
    operator = Operator()
    assembled, = operator(segments(scene(), 7)[list(came)], 1.0)
    message = assembled.message
    assert (pixels_of(assembled) == scene()).all()
    assert (message.height, message.width, message.step, message.encoding) == (48, 64, 128, 'mono16')
    assert (message.header.frame_id, message.header.stamp.to_nsec()) == ('camera', 7 * 10 ** 9 + 5)
    assert isinstance(assembled, RestoredImage) and assembled.error == ImageError(0.0)
    assert (assembled.stamp, assembled.completeness, assembled.changed) == (7 * 10 ** 9 + 5, None, None)
    assert (assembled.mask() == 255).all() and assembled.mask().shape == (48, 64)


def test_how_much_of_the_scene_differs_from_the_layered_image_before() -> None:
    """As of interleaved images: for whether the robot stands still, unless earlier pixels are never shown."""
    images = [scene(), scene(), scene(), scene(30)]
    def changes(integrate: str) -> List[Any]:
        operator = Operator(integrate=integrate)
        return [operator(segments(image, 7 + number), 1.0 + number)[0].changed for number, image in enumerate(images)]
    first, same, again, moved = changes('when_still')
    assert (first, same, again) == (None, 0.0, 0.0) and moved > 0.5
    assert changes('never') == [None] * 4


def test_what_comes_after_an_image_is_complete_is_not_needed_rather_than_late() -> None:
    operator, records = Operator(), segments(scene(), 7)
    assert len(operator(records[:10], 1.0)) == 1
    assert operator(records[10:], 1.001) == [] and operator.dropped == {'not needed': 2}
    assert operator.poll(9.0) == []     # no stamp is published twice


@pytest.mark.parametrize('came, restorable', [(1, 1), (3, 1), (4, 2), (8, 2)])
def test_any_datagrams_show_the_image_the_better_the_more_come(came: int, restorable: int) -> None:
    operator = Operator()
    assert operator(segments(scene(), 7)[:came], 1.0) == []
    assembled, = operator.poll(1.0 + operator.settings['max_wait'])
    assert assembled.error == ImageError(from_byte(ERRORS[restorable - 1]))
    assert (assembled.mask() == 255 - ERRORS[restorable - 1]).all()
    worst = rms(pixels_of(assembled), scene())
    assert 0 < worst < rms(scene(), np.full((48, 64), scene().mean()))
    more = Operator()
    better, = more(segments(scene(), 7)[:came + 1], 1.0) + more.poll(2.0)
    assert rms(pixels_of(better), scene()) <= worst


def test_an_image_that_cannot_be_completed_waits_for_reordered_datagrams_only() -> None:
    operator = Operator()
    assert operator(segments(scene(), 7)[8:], 1.0) == []
    assert operator.assembler.deadline() == pytest.approx(1.0 + QUIET)
    assembled, = operator.poll(1.0 + QUIET)
    assert assembled.error is not None and assembled.error.rms == from_byte(ERRORS[1])


@pytest.mark.parametrize('rate', [1.0, 5.0])
def test_all_layers_of_rare_images_come_before_the_operator_stops_waiting(rate: float) -> None:
    """With the defaults of both sides, and a link that is slower than the robot expects."""
    of = Settings(check({'robot_topic': '/in', 'coding': 'layered', 'rate': rate}, ImageEncoder.PARAMETERS), {})
    encoder, operator, room = ImageEncoder(of.requested), Operator(), 300000.0
    encoder.outlook = Outlook(Air({0.0: 1.0}, None, True), room)
    pixels = np.random.RandomState(1).randint(0, 2000, (240, 320)).astype(np.uint16)
    message = Image(height=240, width=320, encoding='mono16', step=640, data=pixels.tobytes())
    for number in range(1, 3):
        message.header.stamp, now = Time(number, 5), 10.0 * number
        frame, = encoder.encode(message, of, MAX_DATAGRAM_SIZE)
        records, shown = frame.records, []
        for row in range(len(records)):
            shown += operator.poll(now) + operator(records[row:row + 1], now)
            now += size_on_air([frame]) / len(records) / (0.6 * room)
        assembled, = shown + operator.poll(now + QUIET)
        assert assembled.error.rms == from_byte(int(records['errors'][0, -1]))
    assert operator.dropped == {}


def test_where_nothing_can_be_restored_the_image_before_stays() -> None:
    operator = Operator()
    records = segments(scene(), 7)
    stream = encode(scene(), True, 1 << 20)
    layers = [Layer(threshold + 1, size) for threshold, size in layers_of(len(stream.data))]
    records['thresholds'], records['data'] = [layer.threshold for layer in layers], protect(
        stream.data, Plan(COUNT, layers))
    assert operator(records[5:6], 1.0) == [] and operator.poll(9.0) == []
    assert operator.dropped == {'image': 1}
    assert len(operator(segments(scene(), 8), 10.0)) == 1


@pytest.mark.parametrize('encoding, dtype, shape', [
    ('mono8', 'u1', (48, 64)), ('8UC1', 'u1', (1, 1)), ('mono16', '<u2', (33, 7)), ('mono16', '>u2', (48, 64)),
    ('16UC1', '<u2', (1, 40)), ('bgr8', 'u1', (31, 65, 3)), ('rgb8', 'u1', (48, 64, 3)), ('8UC3', 'u1', (48, 64, 3))])
def test_each_encoding_comes_back_as_it_was(encoding: str, dtype: str, shape: Tuple[int, ...]) -> None:
    coded = scene(0, np.uint8 if dtype == 'u1' else np.uint16, shape)
    assembled, = Operator()(segments(coded, 7, encoding, is_bigendian=dtype[0] == '>'), 1.0)
    expected = coded[..., ::-1] if encoding == 'rgb8' else coded
    assert assembled.message.data == expected.astype(dtype).tobytes()
    assert (assembled.message.encoding, assembled.message.is_bigendian) == (encoding, dtype[0] == '>')
    assert assembled.message.step == len(assembled.message.data) // shape[0]
    assert (assembled.error.peak is None) == (dtype != 'u1')


@pytest.mark.parametrize('is_bigendian', [False, True])
def test_depth_keeps_nan_and_infinities(is_bigendian: bool) -> None:
    depth = (scene() / np.float32(4096)).astype(np.float32)
    depth[3:9, 4:20], depth[20:30, 9:11], depth[40, 60] = np.nan, np.inf, -np.inf
    counts, classes = to_counts(depth, 0.25)
    records = segments(counts, 7, '32FC1', classes, depth_unit=0.25, is_bigendian=is_bigendian)
    assembled, = Operator()(records, 1.0)
    found = pixels_of(assembled, '>f4' if is_bigendian else '<f4')
    finite = np.isfinite(depth)
    assert (np.abs(found[finite] - depth[finite]) <= 0.125 + 1e-6).all()
    assert np.array_equal(np.where(finite, 0, found), np.where(finite, 0, depth), equal_nan=True)
    worse = Operator()
    worse(records[:4], 1.0)
    assembled, = worse.poll(2.0)
    assert assembled.error.rms == from_byte(ERRORS[1]) * 0.25      # in metres, as the pixels are


def interleaved(pixels: Any, seconds: int) -> List[Any]:
    """[records of a frame, ...]"""
    message = Image(height=pixels.shape[0], width=pixels.shape[1], encoding='mono16', step=pixels.strides[0],
                    data=pixels.tobytes())
    message.header.stamp, message.header.frame_id = Time(seconds, 5), 'camera'
    return [frame.records for frame in Sender('image', coding='interleaved').frames(message)]


def test_the_coding_may_change_with_each_image() -> None:
    """The newest stamp counts, on whichever part it comes."""
    operator = Operator(fill='nearest')
    (one, *_), two, (three, *rest) = interleaved(scene(1), 1), segments(scene(2), 2), interleaved(scene(3), 3)
    assert operator(one[:2], 1.0, MAIN_PART) == []
    first, = operator(two[:5], 1.1)                     # a newer image finishes the one in progress
    assert first.stamp == 10 ** 9 + 5 and first.error is None and first.known_ratio < 1
    assert operator(one[2:], 1.11, MAIN_PART) == [] and operator.dropped == {'late': len(one) - 2}
    second, = operator(three, 1.2, MAIN_PART)
    third, = (assembled for records in rest for assembled in operator(records, 1.2, MAIN_PART))
    assert (second.stamp, third.stamp) == (2 * 10 ** 9 + 5, 3 * 10 ** 9 + 5)
    assert second.error is not None and (pixels_of(third) == scene(3)).all()
    fourth, = operator(segments(scene(4), 4), 1.3)
    assert (pixels_of(fourth) == scene(4)).all()


def test_an_image_of_one_stamp_has_one_coding() -> None:
    operator = Operator()
    operator(segments(scene(2), 2)[:5], 1.0)
    other, *_ = interleaved(scene(3), 2)
    assert operator(other, 1.0, MAIN_PART) == [] and operator.dropped == {'contradiction': len(other)}


def test_an_error_is_given_in_the_unit_of_the_view() -> None:
    operator = Operator(counts_per_unit=25.0, unit='degC')
    operator(segments(scene(), 7)[:4], 1.0)
    assembled, = operator.poll(2.0)
    assert assembled.error == ImageError(from_byte(ERRORS[1]), None, 25.0, 'degC')
    assert str(assembled.error) == '+-%.2g degC' % (from_byte(ERRORS[1]) / 25)


# -- bad input ------------------------------------------------------------------------------------------


IMPOSSIBLE: List[Tuple[str, Any]] = [
    ('height', 0), ('width', 0), ('height', 4097), ('width', 2 ** 32 - 1), ('encoding', ord('x')),
    ('depth_unit', 0.1), ('depth_unit', math.inf), ('depth_unit', math.nan), ('depth_unit', -1.0),
    ('count', 0), ('count', 3), ('count', 65535), ('count', 241),
    ('thresholds', [0, 4, 9]), ('thresholds', [4, 1, 9]), ('thresholds', [1, 4, 4]), ('thresholds', [1, 4, 13]),
    ('sizes', [0, 1, 1]), ('sizes', [65535, 65535, 65535])]


@pytest.mark.parametrize('field, value', IMPOSSIBLE)
def test_an_impossible_head_begins_no_image(field: str, value: Any) -> None:
    operator, forged = Operator(), segments(scene(), 8)
    forged[field] = value
    assert operator(segments(scene(), 7)[:8], 1.0) == []
    assert operator(forged, 1.0) == [] and operator.dropped == {'impossible head': COUNT}
    assembled, = operator(segments(scene(), 7)[8:], 1.0)      # the image in progress goes on
    assert (pixels_of(assembled) == scene()).all()


@pytest.mark.parametrize('field, value', [
    *IMPOSSIBLE, ('errors', [1, 1, 1]), ('count', 13), ('height', 47), ('encoding', ord('y')), ('is_bigendian', 1)])
def test_a_head_that_contradicts_the_image_in_progress_changes_nothing(field: str, value: Any) -> None:
    operator, forged = Operator(), segments(scene(), 7)
    forged[field] = value
    operator(segments(scene(), 7)[:8], 1.0)
    assert operator(forged, 1.0) == [] and operator.dropped == {'contradiction': COUNT}
    assembled, = operator(segments(scene(), 7)[8:], 1.0)
    assert (pixels_of(assembled) == scene()).all()


def test_tables_of_different_lengths_and_pieces_that_do_not_fit() -> None:
    operator = Operator()
    for lengths in ({'thresholds': 2}, {'sizes': 2}, {'errors': 4}, {'errors': 0}):
        frame = Frame(LayeredSegment, 1, {'encoding': 6, 'thresholds': 3, 'sizes': 3, 'errors': 3, 'data': 99,
                                          **lengths})
        good = segments(scene(), 7)
        for field in ('height', 'width', 'count'):
            frame.records[field] = good[field][0]
        frame.records['encoding'] = good['encoding'][0]
        for field, values in (('thresholds', THRESHOLDS), ('sizes', (33, 33, 33))):
            frame.records[field] = values[:frame.records[field].shape[1]]
        operator(frame.records, 1.0)
    assert operator.dropped == {'impossible head': 4} and operator.poll(9.0) == []
    out = segments(scene(), 7)
    out['index'] += COUNT
    assert operator(out, 10.0) == [] and operator.dropped == {'impossible head': 4, 'contradiction': COUNT}


def head(**changes: Any) -> SimpleNamespace:
    """As of images of 480 x 640 pixels."""
    return SimpleNamespace(**{'height': 480, 'width': 640, 'encoding': 'mono8', 'is_bigendian': 0, 'depth_unit': 0.0,
                              'count': 240, 'thresholds': (120,), 'sizes': (4112,), 'errors': (0,), **changes})


@pytest.mark.parametrize('codes', [2, 17])
def test_a_stream_is_not_much_longer_than_the_pixels_however_many_codes_it_has(codes: int) -> None:
    """The pixels have 307200 bytes, one code 493440."""
    with pytest.raises(ValueError, match='a stream of %d bytes' % (493440 * codes)):
        LayeredImage(head(count=240 * codes), SizeGuard(), 0.0)
    LayeredImage(head(count=240 * codes, sizes=(4112 // codes,)), SizeGuard(), 0.0)


@pytest.mark.parametrize('changes', [
    {'height': 4096, 'width': 1024}, {'encoding': 'mono16', 'width': 1024},     # above the guard's bound
    {'thresholds': (120, 100)}, {'height': 1, 'width': 1}])
def test_what_is_refused_takes_no_memory(changes: Any) -> None:
    tracemalloc.start()
    try:
        with pytest.raises(ValueError):
            LayeredImage(head(**{'count': 4080, 'sizes': (240,), 'thresholds': (120,), **changes}), SizeGuard(), 0.0)
        assert tracemalloc.get_traced_memory()[1] < 100000
    finally:
        tracemalloc.stop()


def test_copies_of_datagrams_are_no_contradiction() -> None:
    operator, records = Operator(), segments(scene(), 7)
    assert operator(np.concatenate([records[:4]] * 3), 1.0) == [] and operator.dropped == {}
    assembled, = operator.poll(2.0)
    assert assembled.error is not None and assembled.error.rms == from_byte(ERRORS[1])


def test_a_stream_of_another_image_is_not_published() -> None:
    operator, forged = Operator(), segments(scene(), 7)
    forged['height'], forged['width'] = 64, 48
    assert operator(forged, 1.0) == [] and operator.dropped == {'image': 1}
    assert len(operator(segments(scene(), 8), 1.1)) == 1


def announce(operator: Operator, height: int, width: int, seconds: int, now: float) -> bool:
    """Whether an image of this size is begun; nothing of it can be decoded."""
    before = operator.dropped.get('impossible head', 0)
    records = segments(scene(), seconds)[:1]
    records['height'], records['width'] = height, width
    operator(records, now)
    return operator.dropped.get('impossible head', 0) == before


def test_sizes_are_bound_by_what_good_images_had() -> None:
    operator = Operator()
    assert len(operator(segments(scene(), 1), 1.0)) == 1
    assert announce(operator, 4096, 4096, 2, 1.1) is False          # above every limit
    assert announce(operator, 1024, 1025, 3, 1.2) is False
    for step in range(40):      # a forger beside the source
        now = 1.3 + 0.1 * step
        assert len(operator(segments(scene(step), 4 + step), now)) == 1
        assert announce(operator, 2048, 2048, 1000 + step, now) is False
        for _ in range(3):
            assert announce(operator, 1024, 1025, 1000 + step, now) is False


def test_images_are_decoded_while_segments_are_received() -> None:
    """A guard is changed by one thread at a time."""
    guard, waits = SizeGuard(), []

    class Cells(int):
        """A size that is compared while another thread has decoded an image."""
        def __gt__(self, other: Any) -> bool:
            return int(self) > other

        def __ne__(self, other: Any) -> bool:
            decoded = threading.Thread(target=guard.good, args=(FIRST, 1.0), daemon=True)
            decoded.start()
            decoded.join(0.1)
            waits.append(decoded)
            assert decoded.is_alive()
            return int(self) != other

        __hash__ = int.__hash__
    with pytest.raises(ValueError):
        guard.check(Cells(FIRST + 1), 1.0)
    waits[0].join(10)
    assert not waits[0].is_alive()
    with pytest.raises(ValueError):     # the good image of the bound's size came in between
        guard.check(FIRST + 1, 1.0 + PROOF)


def test_a_source_may_change_its_size() -> None:
    operator = Operator()
    for second in range(1, 15):
        assert len(operator(segments(scene(), second), float(second))) == 1
    larger = [segments(scene(shape=(96, 128)), second) for second in (20, 21, 22)]
    assert operator(larger[0], 20.0) == [] and operator(larger[1], 20.0 + PROOF / 2) == []
    for records, now in ((larger[2], 20.0 + PROOF), (segments(scene(), 23), 21.1), (larger[0], 30.0)):
        assembled, = operator(records, now)
    assert assembled.message.height == 96


def test_an_image_above_the_first_bound_is_shown_after_a_while() -> None:
    assert FIRST < 2048 * 1024 < MAX_IMAGE_SIZE
    operator = Operator()
    assert announce(operator, 1024, 2048, 1, 1.0) is False and announce(operator, 1024, 2048, 2, 1.4) is False
    assert announce(operator, 1024, 2048, 3, 1.0 + PROOF) is True


def test_numba_is_loaded_with_the_first_layered_image_only() -> None:
    code = ('import sys\n'
            'from smokebot_udp.nodes import operator_stream, image_outputs\n'
            'from smokebot_udp.streams import assembler_class, encoder_class\n'
            'assembler_class("image"); encoder_class("image")\n'
            'sys.exit("numba" in sys.modules)')
    assert subprocess.run([sys.executable, '-c', code], check=False).returncode == 0
