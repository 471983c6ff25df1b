# SPDX-License-Identifier: BSD-3-Clause
"""Prefixes of frames: of every type of message, and back."""
import io
from typing import Any, List

import pytest
from geometry_msgs.msg import PoseStamped, Quaternion, Transform, TransformStamped, Vector3
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import Float32, Header, String
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import (
    InteractiveMarker,
    InteractiveMarkerControl,
    InteractiveMarkerUpdate,
    Marker,
    MarkerArray,
)

from smokebot_udp.numpy_messages import numpy_msg
from smokebot_udp.streams.frame_prefix import add_prefix, strip_prefix, with_prefix


def transform(parent: str, child: str) -> TransformStamped:
    return TransformStamped(Header(frame_id=parent), child, Transform(Vector3(1, 2, 3), Quaternion(0, 0, 0, 1)))


def data(message: Any) -> bytes:
    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


class Goal:
    """A type of a user's: a generated class has these attributes; frames are in it in all places."""
    __slots__ = ['frame_id', 'goal_id', 'path', 'legs', 'names', 'child_frame_id']
    _slot_types = ['string', 'string', 'nav_msgs/Path', 'geometry_msgs/PoseStamped[2]', 'string[]', 'string']


def goal() -> Any:
    made: Any = Goal()
    made.frame_id, made.goal_id, made.child_frame_id, made.names = 'map', 'map', 'gripper', ['map']
    made.path = Path(Header(frame_id='odom'), [PoseStamped(header=Header(frame_id='map'))])
    made.legs = [PoseStamped(header=Header(frame_id=name)) for name in ('a', '')]
    return made


def test_a_custom_type_has_frames_at_any_depth() -> None:
    message = add_prefix(goal(), 'ugv1/')
    assert (message.frame_id, message.child_frame_id) == ('ugv1/map', 'ugv1/gripper')
    assert (message.goal_id, message.names) == ('map', ['map'])
    assert message.path.header.frame_id == 'ugv1/odom'
    assert message.path.poses[0].header.frame_id == 'ugv1/map'
    assert [leg.header.frame_id for leg in message.legs] == ['ugv1/a', '']


def test_transforms() -> None:
    message = add_prefix(TFMessage([transform('map', 'odom'), transform('odom', 'base_link')]), 'ugv1/')
    assert message == TFMessage([transform('ugv1/map', 'ugv1/odom'), transform('ugv1/odom', 'ugv1/base_link')])


def test_odometry() -> None:
    message = add_prefix(Odometry(header=Header(7, None, 'odom'), child_frame_id='base_link'), 'ugv1/')
    assert (message.header.seq, message.header.frame_id, message.child_frame_id) == (7, 'ugv1/odom', 'ugv1/base_link')


def test_markers_and_markers_in_controls_in_markers() -> None:
    markers = [Marker(header=Header(frame_id=name), ns='map', text='map') for name in ('map', 'base_link')]
    message = add_prefix(MarkerArray(markers), 'ugv1/')
    assert [(one.header.frame_id, one.ns, one.text) for one in message.markers] == [
        ('ugv1/map', 'map', 'map'), ('ugv1/base_link', 'map', 'map')]
    control = InteractiveMarkerControl(markers=[Marker(header=Header(frame_id='tool'))])
    update = add_prefix(InteractiveMarkerUpdate(markers=[InteractiveMarker(controls=[control])]), 'ugv1/')
    assert update.markers[0].controls[0].markers[0].header.frame_id == 'ugv1/tool'


@pytest.mark.parametrize('class_', [PointCloud2, Image, OccupancyGrid, numpy_msg(OccupancyGrid)])
def test_the_source_keeps_its_frame_and_large_data_is_shared(class_: Any) -> None:
    source = class_(header=Header(frame_id='map'), data=b'large')
    message = add_prefix(source, 'ugv1/')
    assert (source.header.frame_id, message.header.frame_id) == ('map', 'ugv1/map')
    assert message.data is source.data and type(message) is class_


@pytest.mark.parametrize('message', [Float32(3.0), String('map')])
def test_a_message_without_frames_is_the_same_object(message: Any) -> None:
    assert add_prefix(message, 'ugv1/') is message and strip_prefix(message, 'ugv1/') is message


def test_without_a_prefix_a_message_is_the_same_object() -> None:
    message = Header(frame_id='/map')
    assert add_prefix(message, '') is message and strip_prefix(message, '') is message


@pytest.mark.parametrize('frame, expected', [
    ('map', 'ugv1/map'), ('', ''), ('/map', 'ugv1/map'), ('ugv1/map', 'ugv1/map'), ('ugv12/map', 'ugv1/ugv12/map'),
    ('/ugv1/map', 'ugv1/map'), ('/', '')])
def test_a_frame(frame: str, expected: str) -> None:
    assert add_prefix(Header(frame_id=frame), 'ugv1/').frame_id == expected


def test_a_slash_before_a_frame_or_a_prefix_makes_no_other_frame() -> None:
    for prefix in 'robot_0/', '/robot_0/':
        assert [with_prefix(frame, prefix) for frame in ('/robot_0/x', 'robot_0/x', '/x', 'x')] == ['robot_0/x'] * 4
        assert strip_prefix(Header(frame_id='/robot_0/x'), prefix).frame_id == 'x'


PREFIXES = st.text('abc1_', min_size=1, max_size=5).map(lambda name: name + '/')
FRAMES = st.text('ab/_', max_size=8).map(lambda name: name.lstrip('/'))


@given(st.lists(st.tuples(FRAMES, FRAMES), max_size=5), PREFIXES)
def test_what_is_added_is_taken_off(frames: List[Any], prefix: str) -> None:
    frames = [pair for pair in frames if not any(frame.startswith(prefix) for frame in pair)]
    source = TFMessage([transform(*pair) for pair in frames])
    before, message = data(source), add_prefix(source, prefix)
    assert all(frame.startswith(prefix) or not frame for one in message.transforms
               for frame in (one.header.frame_id, one.child_frame_id))
    assert data(strip_prefix(message, prefix)) == before == data(source)


@given(st.text(max_size=12), PREFIXES)
def test_a_prefix_is_added_and_taken_off_once(frame: str, prefix: str) -> None:
    message = add_prefix(Header(frame_id=frame), prefix)
    assert add_prefix(message, prefix) == message
    bare = strip_prefix(message, prefix)
    assert bare.frame_id == (frame[len(prefix):] if frame.startswith(prefix) else frame.lstrip('/'))
