# SPDX-License-Identifier: BSD-3-Clause
"""Images as video from the robot's encoder to the operator's assembler, by libx264 and libavcodec."""
from typing import Any

import cv2
import needs_numba  # noqa: F401
import needs_pyav  # noqa: F401
import numpy as np
import pytest
from video_sides import (
    NO_LOSS,
    Operator,
    Robot,
    pixels_of,
    psnr,
    run,
    scene,
    settings,
    slices,
)

from smokebot_udp.codecs.layered.quality import UNKNOWN, to_byte
from smokebot_udp.msg import LayeredSegment, VideoSlice
from smokebot_udp.streams.air import Air
from smokebot_udp.streams.image.assembled import DecodedImage
from smokebot_udp.streams.outlook import Outlook
from smokebot_udp.streams.segments import size_on_air

LOSSY = Outlook(Air({0.2: 1.0}, None, True), 1e5)


@pytest.mark.parametrize('encoding', ['mono8', '8UC1', 'bgr8', 'rgb8', '8UC3'])
@pytest.mark.parametrize('size', [(120, 160), (97, 131), (66, 98)])
def test_every_encoding_and_odd_sizes_are_shown(encoding: str, size: Any) -> None:
    robot, operator = Robot(), Operator()
    for number in range(3):
        pixels = scene(number, encoding, *size)
        assembled = operator.receive(robot.records(pixels, number, encoding), number)
        assert isinstance(assembled, DecodedImage)
        image = assembled.message
        assert (image.height, image.width, image.encoding, image.is_bigendian) == (*size, encoding, 0)
        assert image.step * image.height == len(image.data) == pixels.nbytes
        assert image.header.frame_id == 'lens' and assembled.stamp == image.header.stamp.to_nsec()
        assert psnr(pixels_of(assembled), pixels) > (36 if pixels.ndim == 2 else 31)
        assert (assembled.completeness, assembled.known_ratio) == (None, 1.0) and assembled.error is not None
        # libavcodec and OpenCV are the same on both sides; the byte of an error is within 0.28 dB of it
        assert abs(assembled.error.psnr(255) - psnr(pixels_of(assembled), pixels)) < 0.3
        assert str(assembled.error).endswith(' dB')
        assert (assembled.mask() == 255 - to_byte(assembled.error.rms)).all() and assembled.mask().shape == size
    assert set(operator.dropped) <= {'not needed'}


def test_alpha_is_left_out() -> None:
    robot, operator = Robot(), Operator()
    pixels = np.dstack([scene(0, 'rgb8'), scene(1)])
    assembled = operator.receive(robot.records(pixels, 0, 'rgba8'), 0)
    assert assembled is not None and assembled.message.encoding == 'rgb8'
    assert psnr(pixels_of(assembled), pixels[..., :3]) > 31


def test_all_datagrams_say_what_they_are_part_of() -> None:
    robot = Robot(LOSSY)
    for number in range(3):
        parts = slices(robot.frames(scene(number), number))
        first = parts[0]
        assert sorted(part.index for part in parts) == list(range(first.count))
        assert {(part.height, part.width, part.encoding, part.session, part.picture) for part in parts} == {
            (120, 160, 'mono8', 1, number)}
        assert len({(part.sources, part.count, part.flags, part.refresh) for part in parts}) == 1
        assert first.flags == (number == 0) and first.refresh in (5, 10) and 1 <= first.sources < first.count
        with_sets = sorted(part.index for part in parts if part.parameter_sets)
        assert with_sets == (sorted(part.index for part in parts) if number == 0 else [0])
        assert [part.index for part in parts][-1] >= first.sources      # parity last


def test_any_datagrams_as_many_as_slices_show_all_of_an_image() -> None:
    robot, operator = Robot(Outlook(LOSSY.air, 3e5)), Operator()
    for number in range(8):
        pixels = scene(number, height=240, width=320)
        records = robot.records(pixels, number)
        count, sources = int(records[0]['count'][0]), int(records[0]['sources'][0])
        kept = np.random.RandomState(number).permutation(count)[:sources]
        assembled = operator.receive([records[index] for index in kept], number)
        assert assembled is not None and assembled.known_ratio == 1.0, number
        assert psnr(pixels_of(assembled), pixels) > 33


def test_what_came_of_an_image_that_cannot_be_restored_is_shown() -> None:
    robot, operator = Robot(NO_LOSS, max_bytes=20000), Operator()
    run(robot, operator, range(3), lambda number, index: True)
    records = robot.records(scene(3), 3)
    sources = int(records[0]['sources'][0])
    assert sources > 2
    assembled = operator.receive([one for one in records if one['index'][0] < sources - 1], 3)
    assert assembled is not None and assembled.known_ratio == (sources - 1) / sources
    assert psnr(pixels_of(assembled), scene(3)) > 20


@pytest.mark.parametrize('loss, outlook', [(0.02, NO_LOSS), (0.1, NO_LOSS), (0.2, LOSSY), (0.3, LOSSY)])
def test_the_error_of_what_is_shown_is_known_about_through_losses(loss: float, outlook: Outlook) -> None:
    random = np.random.RandomState(3)
    robot, operator = Robot(outlook, max_bytes=20000), Operator()
    estimated, true = [], []
    for number in range(60):
        pixels = scene(number)
        records = robot.records(pixels, number)
        kept = [one for one in records if number < 3 or random.rand() >= loss]
        assembled = operator.receive(kept, number)
        if assembled is not None:
            estimated.append(assembled.error.psnr(255))
            true.append(psnr(pixels_of(assembled), pixels))
    assert len(true) > 25
    assert abs(np.mean(estimated) - np.mean(true)) < 3.0, (np.mean(estimated), np.mean(true))
    assert np.percentile(np.abs(np.subtract(estimated, true)), 90) < 7.0


def test_an_error_that_the_robot_does_not_know_leaves_the_share_of_the_slices() -> None:
    robot, operator = Robot(), Operator()
    records = robot.records(scene(0), 0)
    for one in records:
        one['error'] = UNKNOWN
    assembled = operator.receive(records, 0)
    assert assembled is not None and (assembled.error, assembled.completeness) == (None, 1.0)
    assert (assembled.mask() == 255).all()


def test_images_that_are_lost_as_a_whole_stop_nothing() -> None:
    """Without a slice in place of each, libavcodec is silent where frame_num wraps."""
    robot, operator = Robot(NO_LOSS), Operator()
    found = run(robot, operator, range(48), lambda number, index: number < 3 or number % 5 != 1)
    shown = [number for number, one in enumerate(found) if one is not None]
    assert shown == [number for number in range(48) if number < 3 or number % 5 != 1]
    assert all(one is not None and one > 24 for one in (found[number] for number in shown))


def test_the_size_and_the_encoding_change_at_any_time() -> None:
    robot, operator = Robot(), Operator()
    kinds = [('mono8', 120, 160), ('bgr8', 97, 131), ('mono8', 200, 200), ('mono8', 120, 160)]
    for number in range(12):
        encoding, height, width = kinds[number // 3]
        pixels = scene(number, encoding, height, width)
        assembled = operator.receive(robot.records(pixels, number, encoding), number)
        assert assembled is not None and psnr(pixels_of(assembled), pixels) > 30, number
    assert robot.sessions == 4


def test_an_operator_that_joins_gets_an_image_that_needs_no_other() -> None:
    robot = Robot()
    for number in range(5):
        robot.frames(scene(number), number)
    late = Operator()
    robot.operators = ('desk', 'late')
    found = run(robot, late, range(5, 8), lambda number, index: True)
    assert all(one is not None and one > 33 for one in found)


def test_what_joins_unnoticed_is_shown_nothing_grey_and_asks_for_a_beginning() -> None:
    robot = Robot()
    for number in range(5):
        robot.frames(scene(number), number)
    found = run(robot, Operator(), range(5, 25), lambda number, index: True)
    assert found[0] is None and found[1] is not None and all(one is not None and one > 33 for one in found[1:])


def test_after_a_long_loss_the_next_report_brings_a_beginning() -> None:
    robot, operator = Robot(), Operator()
    found = run(robot, operator, range(50), lambda number, index: not 10 <= number < 30)
    assert all(one is not None for one in found[:10]) and all(one is None for one in found[10:30])
    assert all(one is not None and one > 33 for one in found[32:])


def test_half_of_all_datagrams_may_be_lost() -> None:
    robot, operator = Robot(Outlook(Air({0.5: 1.0}, None, True), 1e5)), Operator()
    lost = np.random.RandomState(3).rand(60, 300) < 0.5
    found = run(robot, operator, range(60), lambda number, index: not lost[number, index])
    shown = [one for one in found[5:] if one is not None]
    assert len(shown) >= 45 and np.mean(shown) > 30
    gaps = ''.join('.' if one is None else '#' for one in found[5:]).split('#')
    assert max(map(len, gaps)) <= 4


def test_images_keep_to_max_bytes_on_average_and_to_the_room_of_the_link() -> None:
    for outlook, changes, budget in ((NO_LOSS, {'max_bytes': 3000}, 3000), (Outlook(NO_LOSS.air, 4e4), {}, 4000)):
        robot = Robot(outlook, **changes)
        sizes = [size_on_air(robot.frames(scene(number, height=240, width=320), number)) for number in range(30)]
        assert 0.5 * budget < np.mean(sizes[5:]) < 1.05 * budget


def test_an_image_that_would_come_too_late_is_not_sent_and_the_next_ones_repair_it() -> None:
    def noise(number: int) -> Any:
        return np.random.RandomState(number).randint(0, 256, (240, 320)).astype(np.uint8)
    robot, operator = Robot(Outlook(NO_LOSS.air, 1e5)), Operator()
    for number in range(4):
        assert operator.receive(robot.records(noise(number), number), number)
    robot.encoder.see(outlook=Outlook(NO_LOSS.air, 0.4e5))   # libx264 follows with the next image but one
    assert robot.frames(noise(4), 4) == [] and robot.encoder.message_size
    for number in range(5, 20):
        shown = operator.receive(robot.records(scene(number, height=240, width=320), number), number)
        assert shown is not None and shown.known_ratio == 1.0
    assert psnr(pixels_of(shown), scene(19, height=240, width=320)) > 33


def test_a_link_without_a_limit_needs_none() -> None:
    robot, operator = Robot(Outlook(NO_LOSS.air)), Operator()
    for number in range(3):
        shown = operator.receive(robot.records(scene(number), number), number)
    assert shown is not None and psnr(pixels_of(shown), scene(2)) > 40


def large() -> Any:
    cells = np.random.RandomState(1).randint(0, 256, (135, 240)).astype(np.uint8)
    return cv2.resize(cells, (1920, 1080), interpolation=cv2.INTER_CUBIC)


def test_where_the_link_has_no_room_for_video_images_are_layered_and_it_is_said() -> None:
    robot = Robot(Outlook(NO_LOSS.air, 3000.0))
    assert {frame.message_class for frame in robot.frames(large(), 0)} == {LayeredSegment}
    warning, = robot.encoder.warnings
    assert 'no room for video of 1920 x 1080 pixels' in warning
    robot.encoder.see(outlook=NO_LOSS)
    assert {frame.message_class for frame in robot.frames(large(), 1)} == {VideoSlice}
    assert len(robot.encoder.warnings) == 1


def test_a_link_on_which_a_beginning_is_too_large_gets_video_nevertheless() -> None:
    robot, operator = Robot(Outlook(NO_LOSS.air, 3.2e4)), Operator()
    pixels, shown = large(), []
    for number in range(24):
        shown.append(operator.receive(robot.records(pixels, number), number))
        holding = operator.assembler.holding()
        if holding is not None:
            robot.encoder.held('desk', holding)
    assert shown[0] is None and any(shown)


def test_operating_points_are_fewer_images() -> None:
    robot = Robot()
    assert robot.encoder.operating_points(20.0, robot.settings) == []
    robot.frames(scene(0), 0)
    points = robot.encoder.operating_points(20.0, robot.settings)
    assert points[-1].settings == {'rate': 20.0} and points[0].settings['rate'] < 20.0
    assert [point.cost for point in points] == sorted(point.cost for point in points)
    assert robot.encoder.refine(points[0].settings, 1e9) == points[0].settings


@pytest.mark.parametrize('encoding, pixels', [
    ('mono16', scene(0).astype(np.uint16)), ('32FC1', scene(0).astype(np.float32)),
    ('8UC4', np.dstack([scene(0)] * 4))])
def test_what_cannot_be_video_is_refused(encoding: str, pixels: Any) -> None:
    reason = "coding is h264, but encoding is '%s', which cannot be video; mono8," % encoding
    with pytest.raises(ValueError, match=reason):
        Robot().frames(pixels, 0, encoding)


def test_scale_and_the_parts() -> None:
    robot = Robot(scale=2)
    assert slices(robot.frames(scene(0), 0))[0].height == 60
    assert robot.encoder.parts(settings()) == ['segments', 'layers', 'video']
    for coding in ('auto', 'layered'):
        assert robot.encoder.parts(settings(coding=coding)) == ['segments', 'layers']
    assert {frame.message_class for frame in robot.frames(scene(1), 1)} == {VideoSlice}
