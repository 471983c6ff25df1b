# SPDX-License-Identifier: BSD-3-Clause
"""Images in layers on the operator's side: which image is made of which datagrams."""
from typing import Any, List, Sequence, Tuple

import needs_numba  # noqa: F401
import numpy as np
import pytest
from genpy import Time
from layered_operator import (
    COUNT,
    ERRORS,
    Operator,
    layers_of,
    pixels_of,
    rms,
    scene,
    segments,
)
from sensor_msgs.msg import Image

from evaluation.linked_encoder import LinkedEncoder
from evaluation.offline_link import MAX_DATAGRAM_SIZE, Sender
from smokebot_udp.codecs.layered.depth import to_counts
from smokebot_udp.codecs.layered.image import encode
from smokebot_udp.codecs.layered.pieces import Layer, Plan, protect
from smokebot_udp.codecs.layered.quality import from_byte
from smokebot_udp.image_error import ImageError
from smokebot_udp.mission.parameters import check
from smokebot_udp.mission.settings import Settings
from smokebot_udp.streams.air import Air
from smokebot_udp.streams.frame_end import FIRST_MARGIN
from smokebot_udp.streams.image.assembled import DecodedImage
from smokebot_udp.streams.image.encoder import ImageEncoder
from smokebot_udp.streams.image.layered_receiver import LayeredReceiver
from smokebot_udp.streams.outlook import Outlook
from smokebot_udp.streams.segments import MAIN_PART, size_on_air


@pytest.mark.parametrize('came', [range(9), range(3, 12), [11, 0, 7, 3, 5, 9, 2, 4, 8]])
def test_enough_datagrams_make_the_exact_image_at_once(came: Sequence[int]) -> None:
    operator = Operator()
    assembled, = operator(segments(scene(), 7)[list(came)], 1.0)
    message = assembled.message
    assert (pixels_of(assembled) == scene()).all()
    assert (message.height, message.width, message.step, message.encoding) == (48, 64, 128, 'mono16')
    assert (message.header.frame_id, message.header.stamp.to_nsec()) == ('camera', 7 * 10 ** 9 + 5)
    assert isinstance(assembled, DecodedImage) and assembled.error == ImageError(0.0)
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
    assert operator.assembler.deadline() == pytest.approx(1.0 + FIRST_MARGIN)
    assembled, = operator.poll(1.0 + FIRST_MARGIN)
    assert assembled.error is not None and assembled.error.rms == from_byte(ERRORS[1])


@pytest.mark.parametrize('rate', [1.0, 5.0])
def test_all_layers_of_rare_images_come_before_the_operator_stops_waiting(rate: float) -> None:
    """With the defaults of both sides, and a link that is slower than the robot expects."""
    of = Settings(check({'robot_topic': '/in', 'coding': 'layered', 'rate': rate}, ImageEncoder.PARAMETERS), {})
    encoder, operator, room = LinkedEncoder(ImageEncoder(of.requested)), Operator(), 300000.0
    encoder.see(outlook=Outlook(Air({0.0: 1.0}, None, True), room))
    pixels = np.random.RandomState(1).randint(0, 2000, (240, 320)).astype(np.uint16)
    message = Image(height=240, width=320, encoding='mono16', step=640, data=pixels.tobytes())
    for number in range(1, 3):
        message.header.stamp, now = Time(number, 5), 10.0 * number
        frame, = encoder.encode(message, of, MAX_DATAGRAM_SIZE)
        records, shown = frame.records, []
        for row in range(len(records)):
            shown += operator.poll(now) + operator(records[row:row + 1], now)
            now += size_on_air([frame]) / len(records) / (0.6 * room)
        assembled, = shown + operator.poll(now + FIRST_MARGIN)
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
    np.testing.assert_array_equal(np.where(finite, 0, found), np.where(finite, 0, depth))
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


def test_what_is_held_is_reported_also_while_the_next_image_is_decoded(monkeypatch: Any) -> None:
    operator, seen, decode = Operator(), [], LayeredReceiver.decode      # type: Any, List[Any], Any

    def watched(*given: Any) -> Any:
        seen.append(operator.assembler.holding())
        return decode(*given)
    monkeypatch.setattr(LayeredReceiver, 'decode', watched)
    for number in range(3):
        operator(segments(scene(), 7 + number), 1.0 + number)
    assert seen[0] is None and None not in seen[1:]
