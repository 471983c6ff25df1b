# SPDX-License-Identifier: BSD-3-Clause
"""What is sent, and what is said, where video is not available on a side."""
import sys
from typing import Any, Collection, List

import pytest
from genpy import Time
from sensor_msgs.msg import Image

from evaluation.linked_encoder import LinkedEncoder
from smokebot_udp.mission.parameters import check
from smokebot_udp.mission.settings import Settings
from smokebot_udp.msg import ImageSegment
from smokebot_udp.streams.image import encoder
from smokebot_udp.streams.image.encoder import CONNECTED, MISSING, ImageEncoder
from smokebot_udp.streams.segments import LAYERS, MAIN_PART


class Loaded:
    """A codec that is there."""

    def ready(self) -> bool:
        return True


class Robot:
    """One whose operators receive interleaved images only."""

    def __init__(self, coding: str = 'h264', operators: Collection[str] = ('/desk', '/tablet')) -> None:
        self.settings = Settings(check({'robot_topic': '/in', 'coding': coding}, ImageEncoder.PARAMETERS))
        self.now = 0.0
        self.encoder = LinkedEncoder(ImageEncoder(self.settings.requested, Loaded(), lambda: self.now))
        self.encoder.see(heard=lambda part: part == MAIN_PART)
        self.encoder.see(operators=lambda part: operators if part == MAIN_PART else ())

    def warnings(self, now: float) -> List[str]:
        """The warnings about an image at this time."""
        self.now = now
        image = Image(height=2, width=3, encoding='mono8', step=3, data=bytes(6))
        image.header.stamp = Time.from_sec(100 + now)
        frames: Any = self.encoder.encode(image, self.settings, 1472)
        assert {frame.message_class for frame in frames} == {ImageSegment}
        found = list(self.encoder.warnings)
        self.encoder.warnings.clear()
        return found


def hide(monkeypatch: Any, hidden: bool) -> None:
    monkeypatch.setattr(encoder, 'found', lambda name: name == 'av' and not hidden)


@pytest.mark.parametrize('coding, warnings', [('h264', [MISSING]), ('auto', []), ('layered', [])])
def test_without_pyav_on_the_robot_its_log_says_so_where_video_is_asked_for(
        monkeypatch: Any, coding: str, warnings: List[str]) -> None:
    hide(monkeypatch, True)
    robot = Robot(coding)
    assert robot.warnings(0.0) == warnings
    assert 'video' not in robot.encoder.parts(robot.settings)


def test_operators_that_do_not_receive_video_are_named_once_they_should(monkeypatch: Any) -> None:
    hide(monkeypatch, False)
    robot = Robot()
    robot.encoder.see(why_not=lambda part, operator: 'lacks ' + part)
    assert robot.warnings(10.0) == [] and robot.warnings(10.0 + CONNECTED) == []
    warning, = robot.warnings(10.1 + CONNECTED)
    assert 'video is not sent: /desk lacks video; /tablet lacks video.' in warning
    assert Robot(operators=()).warnings(10.0) == []


def test_where_pyav_cannot_be_imported_images_are_sent_nevertheless(monkeypatch: Any) -> None:
    hide(monkeypatch, False)
    monkeypatch.delitem(sys.modules, 'smokebot_udp.streams.image.video_encoder', raising=False)
    monkeypatch.delitem(sys.modules, 'smokebot_udp.codecs.video.encoder', raising=False)
    monkeypatch.setitem(sys.modules, 'av', None)
    robot = Robot()
    robot.encoder.see(heard=lambda part: part != LAYERS)
    warning, = robot.warnings(0.0)
    assert 'PyAV cannot be used here: ModuleNotFoundError' in warning
    assert robot.warnings(1.0) == []
