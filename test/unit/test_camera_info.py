# SPDX-License-Identifier: BSD-3-Clause
"""Calibrations of images: cut and scaled, sent, and found again for each image."""
import collections
from typing import Any, List, Optional

import numpy as np
import pytest
from genpy import Time
from hypothesis import given
from hypothesis import strategies as st
from sensor_msgs.msg import CameraInfo, Image, RegionOfInterest

from smokebot_udp.msg import CameraInfoSegment
from smokebot_udp.serialised import serialised
from smokebot_udp.streams.image.camera_info import Region, info_topic, parse_region, part_info, whole
from smokebot_udp.streams.image.info_history import REMEMBERED, InfoHistory
from smokebot_udp.streams.image.info_sender import COPIES, FIRST_IMAGES, PERIOD, InfoSender
from smokebot_udp.streams.image.source import SourceImage

SIZE = 480, 640
DATAGRAM = 1472


def info(fx: float = 500.0, size: Any = SIZE, **changes: Any) -> CameraInfo:
    return CameraInfo(**{
        'height': size[0], 'width': size[1], 'distortion_model': 'plumb_bob', 'D': [-0.1, 0.01, 0.0, 0.0, 0.0],
        'K': [fx, 0.5, 319.5, 0.0, 400.0, 239.5, 0.0, 0.0, 1.0], 'R': [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        'P': [fx, 0.0, 319.5, -50.0, 0.0, 400.0, 239.5, 20.0, 0.0, 0.0, 1.0, 0.0], **changes})


@pytest.mark.parametrize('image, wanted', [
    ('/camera/image_raw', '/camera/camera_info'), ('/camera/image_raw/compressed', '/camera/camera_info'),
    ('camera/rgb/image', 'camera/rgb/camera_info'), ('image', 'camera_info'), ('/image', '/camera_info'),
    ('/depth/image/compressedDepth', '/depth/camera_info'), ('compressed', 'camera_info')])
def test_topics_as_image_transport_has_them(image: str, wanted: str) -> None:
    assert info_topic(image) == wanted


def test_the_whole_image_in_full_size_has_the_cameras() -> None:
    assert part_info(info(), whole(*SIZE), SIZE, 1) == info()
    binned = info(binning_x=2, binning_y=2, roi=RegionOfInterest(10, 20, 400, 600, True))
    assert part_info(binned, whole(200, 300), (200, 300), 1) == binned


def test_scaled_by_hand() -> None:
    found = part_info(info(), whole(*SIZE), SIZE, 4)
    # the centre of 640 columns is at 319.5, of 160 columns at 79.5
    assert found.K == [125.0, 0.125, 79.5, 0.0, 100.0, 59.5, 0.0, 0.0, 1.0]
    assert found.P == [125.0, 0.0, 79.5, -12.5, 0.0, 100.0, 59.5, 5.0, 0.0, 0.0, 1.0, 0.0]
    assert (found.height, found.width, found.D, found.R) == (120, 160, info().D, info().R)


def test_cut_and_scaled_by_hand() -> None:
    found = part_info(info(), Region(101, 40, 203, 99), SIZE, 2)
    # (319.5 - 101 + 0.5) / 2 - 0.5, (239.5 - 40 + 0.5) / 2 - 0.5; incomplete blocks count
    assert (found.K[2], found.K[5], found.K[0], found.K[4]) == (109.0, 99.5, 250.0, 200.0)
    assert (found.height, found.width) == (50, 102)
    assert info().K[2] == 319.5     # the camera's message is not changed


def test_the_cameras_own_binning_and_region() -> None:
    camera = info(binning_x=2, binning_y=4, roi=RegionOfInterest(100, 40, 200, 400, True))
    found = part_info(camera, Region(10, 5, 100, 40), (50, 200), 1)
    # image_geometry: (319.5 - 100) / 2 and (239.5 - 40) / 4, then the region
    assert (found.K[2], found.K[5], found.K[0], found.K[4]) == (99.75, 44.875, 250.0, 100.0)
    assert (found.binning_x, found.binning_y, found.roi) == (0, 0, RegionOfInterest())


def test_a_camera_without_calibration_stays_so() -> None:
    found = part_info(info(0.0), Region(0, 0, 100, 100), SIZE, 2)
    assert found.K == info(0.0).K and found.P == info(0.0).P and (found.height, found.width) == (50, 50)
    assert part_info(CameraInfo(), whole(*SIZE), SIZE, 1).width == 640
    assert part_info(CameraInfo(), Region(0, 0, 100, 100), SIZE, 2).width == 50


def test_another_size_is_refused() -> None:
    with pytest.raises(ValueError, match='camera_info is of 640 x 480 pixels, the image has 1280 x 960'):
        part_info(info(), whole(960, 1280), (960, 1280), 1)


@given(st.integers(0, 99), st.integers(0, 99), st.integers(1, 16), st.floats(0, 639), st.floats(0.5, 4))
def test_a_point_is_seen_where_its_block_is(x: int, y: int, scale: int, column: float, depth: float) -> None:
    found = part_info(info(), Region(x, y, 300, 300), SIZE, scale)
    ray = (column - info().K[2]) / info().K[0]      # skew apart
    shown = found.K[0] * ray + found.K[2]
    assert shown == pytest.approx((column - x + 0.5) / scale - 0.5)


@pytest.mark.parametrize('text, wanted', [
    ('', None), ('  ', None), ('1, 2, 3, 4', Region(1, 2, 3, 4)), ('1 2 3 4', Region(1, 2, 3, 4)),
    ('0,0,640,480', Region(0, 0, 640, 480))])
def test_regions_are_read(text: str, wanted: Optional[Region]) -> None:
    assert parse_region(text) == wanted


@pytest.mark.parametrize('text', ['1, 2, 3', '1, 2, 3, 4, 5', '-1, 2, 3, 4', '1.5, 2, 3, 4', 'a', '1, 2, 0, 4',
                                  '1, 2, 3, 0', '1, 2, 3, 99999999'])
def test_wrong_regions_are_named(text: str) -> None:
    with pytest.raises(ValueError, match='region is %r' % text):
        parse_region(text)


@pytest.mark.parametrize('region, even, wanted', [
    (Region(2, 1, 3, 4), False, Region(2, 1, 3, 4)), (Region(5, 4, 100, 100), False, Region(5, 4, 5, 4)),
    (Region(3, 1, 4, 4), True, Region(2, 0, 4, 4)), (Region(3, 1, 100, 100), True, Region(2, 0, 8, 8))])
def test_regions_are_clipped(region: Region, even: bool, wanted: Region) -> None:
    assert region.within(8, 10, even) == wanted


@pytest.mark.parametrize('region, even, problem', [
    (Region(10, 0, 4, 4), False, 'nothing'), (Region(0, 8, 4, 4), False, 'nothing'),
    (Region(10, 0, 4, 4), True, 'nothing'), (Region(0, 0, 1, 4), True, 'no whole cell of 2 x 2 pixels')])
def test_regions_outside_are_refused(region: Region, even: bool, problem: str) -> None:
    with pytest.raises(ValueError, match=problem + ' of it is in an image of 10 x 8 pixels'):
        region.within(8, 10, even)


def image(seconds: int, nanoseconds: int = 0) -> SourceImage:
    message = Image(height=SIZE[0], width=SIZE[1])
    message.header.stamp, message.header.frame_id = Time(seconds, nanoseconds), 'lens'
    return SourceImage(message, whole(*SIZE), *SIZE)


def sent(sender: InfoSender, seconds: int, now: float, scale: int = 1, operators: Any = ('/a',)) -> List[Any]:
    """The records that are sent with an image."""
    frames = sender.frames(image(seconds), scale, operators, now, DATAGRAM)
    return [record for frame in frames for record in frame.records]


def stamped(seconds: int, fx: float = 500.0) -> CameraInfo:
    found = info(fx)
    found.header.stamp = Time(seconds)
    return found


def read(found: Any) -> CameraInfoSegment:
    return CameraInfoSegment().deserialize(found.tobytes())


def test_nothing_is_sent_before_the_camera_says_it() -> None:
    assert sent(InfoSender(), 1, 0.0) == []


def test_it_is_sent_at_first_often_and_then_once_a_second() -> None:
    sender = InfoSender()
    sender.add(stamped(1))
    counts = [len(sent(sender, 1 + k, k / 8)) for k in range(FIRST_IMAGES + 40)]
    assert counts[:FIRST_IMAGES] == [COPIES] + [1] * (FIRST_IMAGES - 1)
    later = np.flatnonzero(counts[FIRST_IMAGES:])
    assert len(later) == 5 and (np.diff(later) == 8 * PERIOD).all()


def test_a_change_and_a_new_operator_are_served_at_once() -> None:
    sender = InfoSender()
    sender.add(stamped(1))
    for k in range(FIRST_IMAGES):
        sent(sender, 1 + k, 0.0)
    assert not sent(sender, 20, 0.1)
    assert len(sent(sender, 21, 0.2, operators=('/a', '/b'))) == COPIES
    found = read(sent(sender, 22, 0.3, scale=2)[0])
    assert (found.since, found.header.stamp, found.header.frame_id) == (Time(22), Time(22), 'lens')
    assert found.info.width == 320
    assert read(sent(sender, 23, 0.4, scale=2)[0]).since == Time(22)
    sender.add(stamped(24, 700.0))
    assert read(sent(sender, 24, 0.5, scale=2)[0]).info.K[0] == 350.0


def test_that_of_the_images_stamp_is_taken() -> None:
    sender = InfoSender()
    for seconds in (1, 2, 3):
        sender.add(stamped(seconds, 100.0 * seconds))
    assert read(sent(sender, 2, 0.0)[0]).info.K[0] == 200.0
    assert read(sent(sender, 9, 0.0)[0]).info.K[0] == 300.0


def test_what_does_not_fit_is_refused() -> None:
    sender = InfoSender()
    sender.add(info(D=[0.0] * 500))
    with pytest.raises(ValueError, match='camera_info has 500 distortion parameters, must be [0-9]+ at most'):
        sent(sender, 1, 0.0)


def history() -> Any:
    dropped: Any = collections.Counter()
    return InfoHistory(dropped), dropped


def test_each_image_has_that_of_its_time_whatever_is_lost() -> None:
    """Every image after one that arrived has the right calibration, although many segments are lost."""
    sender, (known, _), random = InfoSender(), history(), np.random.RandomState(3)
    scale, right = 1, 0
    for k in range(300):
        if k == 0 or k % 37 == 0:
            scale = 1 + scale % 4
            sender.add(stamped(k, 500.0 + k))
        for segment in sent(sender, k, k / 10, scale):
            if random.uniform() >= 0.2:
                known.receive(segment)
        found = known.of(k * 10 ** 9, -(-480 // scale), -(-640 // scale))
        if found is not None:
            assert found.K[0] == (500.0 + k - k % 37) / scale
            right += 1
    assert right == 300 and not known.unknown


def test_an_image_of_another_size_or_an_earlier_time_has_none() -> None:
    sender, (known, _) = InfoSender(), history()
    sender.add(stamped(5))
    for found in sent(sender, 5, 0.0):
        known.receive(found)
    assert known.of(5 * 10 ** 9, *SIZE) == part_info(info(), whole(*SIZE), SIZE, 1)
    assert known.of(5 * 10 ** 9 - 1, *SIZE) is None and known.unknown
    assert known.of(6 * 10 ** 9, 480, 641) is None
    assert known.of(6 * 10 ** 9, *SIZE) is not None and not known.unknown


def test_time_that_goes_back_begins_anew() -> None:
    sender, (known, _) = InfoSender(), history()
    for seconds, fx in ((100, 500.0), (1, 700.0)):
        sender.add(stamped(seconds, fx))
        for found in sent(sender, seconds, 0.0):
            known.receive(found)
    assert known.of(2 * 10 ** 9, *SIZE).K[0] == 700.0 and known.of(200 * 10 ** 9, *SIZE).K[0] == 700.0


def record(segment: CameraInfoSegment) -> Any:
    return np.frombuffer(serialised(segment), np.uint8)


@pytest.mark.parametrize('segment', [
    CameraInfoSegment(info=info(float('nan'))), CameraInfoSegment(info=info(float('inf'))),
    CameraInfoSegment(info=info(), since=Time(1))])
def test_forged_ones_are_refused(segment: CameraInfoSegment) -> None:
    known, dropped = history()
    known.receive(record(segment))
    assert dropped == {'camera_info': 1} and known.of(10 ** 18, *SIZE) is None


def test_a_forger_fills_no_memory() -> None:
    known, _ = history()
    for k in range(1000):
        segment = CameraInfoSegment(info=info(float(k)), since=Time(k))
        segment.header.stamp = Time(k)
        known.receive(record(segment))
    assert known.of((1000 - REMEMBERED) * 10 ** 9, *SIZE).K[0] == 1000 - REMEMBERED
    assert known.of((1000 - REMEMBERED) * 10 ** 9 - 1, *SIZE) is None
