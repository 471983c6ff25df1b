# SPDX-License-Identifier: BSD-3-Clause
"""What the demo's report compares of images."""
from typing import Any, Callable, Dict

import pytest
import rospy
from sensor_msgs.msg import Image

from smokebot_udp.demo.images import ImageComparison

SETTINGS = {'robot_topic': '/thermal', 'operator_topic': '/operator/thermal', 'view_topic': '', 'type': 'image',
            'rate': 1.0}


COME: Dict[str, Callable[[Any], None]] = {}
"""{topic: what takes its messages}"""


def sends(message: Any) -> None:
    COME['/thermal'](message)


def receives(message: Any) -> None:
    COME['/operator/thermal'](message)


@pytest.fixture
def comparison(monkeypatch: Any) -> ImageComparison:
    monkeypatch.setattr(rospy, 'Subscriber', lambda topic, _, callback, **__: COME.update({topic: callback}))
    monkeypatch.setattr(rospy.Time, 'now', lambda: rospy.Time(10.1))
    return ImageComparison('thermal', SETTINGS, False)


def image(width: int, encoding: str = 'mono8', value: int = 7) -> Any:
    size = 2 if encoding == 'mono16' else 1
    message = Image(height=2, width=width, encoding=encoding, step=size * width, data=bytes([value]) * 2 * size * width)
    message.header.stamp = rospy.Time(10)
    return message


def test_images_that_differ_in_size_or_type_are_not_called_exact(comparison: ImageComparison) -> None:
    sends(image(4))
    receives(image(2))
    result = comparison.compared(1.0)
    assert result.row(0.0)[5:] == (
        'unknown', 'not compared: 4 x 2 mono8 is sent, 2 x 2 mono8 comes, age p50 100 ms, p99 100 ms')
    receives(image(4, 'mono16'))
    assert '4 x 2 mono16 comes' in comparison.compared(1.0).row(0.0)[6]
    receives(image(4))
    assert comparison.compared(1.0).row(0.0)[6].startswith(
        'all exact of 1 compared, 2 not compared: 4 x 2 mono8 is sent, 4 x 2 mono16 comes, ')
    comparison.reset()
    receives(image(4, value=17))
    assert comparison.compared(1.0).row(0.0)[6].startswith('PSNR 28.1 dB, ')


def test_images_without_an_original_are_counted(comparison: ImageComparison) -> None:
    sends(image(4))
    receives(image(4))
    for _ in range(3):
        other = image(4)
        other.header.stamp = rospy.Time(9)
        receives(other)
    assert comparison.compared(1.0).row(0.0)[6].startswith(
        'all exact of 1 compared, 3 not compared: no original has their stamps, ')
    comparison.reset()
    receives(image(4))
    assert comparison.compared(1.0).row(0.0)[6].startswith('all exact, ')
