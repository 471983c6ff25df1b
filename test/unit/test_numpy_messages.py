# SPDX-License-Identifier: BSD-3-Clause
"""Messages of numpy arrays are the messages that they stand for, with any numpy."""
from typing import Any

import numpy as np
import pytest
from map_msgs.msg import OccupancyGridUpdate
from nav_msgs.msg import OccupancyGrid
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Header

from smokebot_udp.numpy_messages import numpy_msg
from smokebot_udp.serialised import serialised

pytestmark = pytest.mark.filterwarnings('error')
"""Warnings are errors. Versions of numpy before 2.3 warn of tostring()."""

CASES = [(OccupancyGrid, {'data': np.arange(-1, 100, dtype=np.int8)}),
         (OccupancyGridUpdate, {'x': 3, 'data': np.arange(-1, 100, dtype=np.int8)}),
         (LaserScan, {'angle_min': 0.5, 'ranges': np.float32([1.5, np.inf, np.nan]),
                      'intensities': np.arange(3, dtype=np.float32)})]


@pytest.mark.parametrize('message_class, fields', CASES, ids=lambda value: getattr(value, '__name__', ''))
def test_they_are_written_and_read_alike(message_class: Any, fields: Any) -> None:
    header = Header(seq=7, frame_id='map')
    plain = message_class(header=header, **{name: value.tolist() if isinstance(value, np.ndarray) else value
                                            for name, value in fields.items()})
    message = numpy_msg(message_class)(header=header, **fields)
    data = serialised(message)
    assert data == serialised(plain)
    read = numpy_msg(message_class)().deserialize(data)
    for name, value in fields.items():
        np.testing.assert_array_equal(getattr(read, name), value)
        assert getattr(message, name) is value
    assert serialised(read) == data


@pytest.mark.parametrize('message_class', [case[0] for case in CASES])
def test_the_class_is_one_and_describes_itself(message_class: Any) -> None:
    made = numpy_msg(message_class)
    assert made is numpy_msg(message_class) and issubclass(made, message_class)
    for name in ('_type', '_md5sum', '_full_text', '_has_header', '_slot_types', '__slots__'):
        assert getattr(made(), name) == getattr(message_class(), name), name
