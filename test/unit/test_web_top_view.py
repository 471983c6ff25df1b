# SPDX-License-Identifier: BSD-3-Clause
import math
from typing import Any

import cv2
import numpy as np
import pytest
from geometry_msgs.msg import TransformStamped
from rosgraph_msgs.msg import Log
from tf2_msgs.msg import TFMessage

from smokebot_udp.msg import LinkStatus, RobotStatus
from smokebot_udp.web.captures import listed, path_of
from smokebot_udp.web.log_entries import MAX_ENTRIES, LogEntries
from smokebot_udp.web.state import MAX_TEXT, MAX_TEXTS, Known, overview_of, state_of
from smokebot_udp.web.top_view import (
    CELL,
    MAX_SCAN_POINTS,
    SPAN,
    Pose,
    ages_image,
    cloud_from_above,
    path_points,
    scan_points,
)
from smokebot_udp.web.transforms import MAX_FRAMES, Transforms

HERE = Pose(np.eye(3), np.zeros(3))
TURNED = Pose(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.array([1.0, 2.0, 0.0]))


def test_the_ends_of_beams_in_the_fixed_frame() -> None:
    ranges = np.array([1.0, math.inf, math.nan, -math.inf, 0.01, 50.0, 2.0], np.float32)
    points = scan_points(ranges, 0.0, math.pi / 6, (0.1, 30.0), TURNED)
    assert points.dtype == np.dtype('<f4') and points.tolist() == pytest.approx(np.array([[1.0, 3.0], [1.0, 0.0]]))


def test_a_long_scan_is_thinned() -> None:
    points = scan_points(np.ones(10 * MAX_SCAN_POINTS, np.float32), 0.0, 1e-4, (0.1, 30.0), HERE)
    assert MAX_SCAN_POINTS // 2 < len(points) <= MAX_SCAN_POINTS
    assert scan_points(np.zeros(0, np.float32), 0.0, 0.1, (0.1, 30.0), HERE).shape == (0, 2)


def test_the_highest_point_of_each_pixel_is_seen() -> None:
    base = Pose(np.eye(3), np.array([5.0, -3.0, 0.0]))
    points = np.array([[5.05, -2.95, 2.0], [5.05, -2.95, -1.0], [5.05 + SPAN, 0.0, 1.0]], np.float32)
    view = cloud_from_above(points, HERE, base)
    pixels = cv2.imdecode(np.frombuffer(view.png, np.uint8), cv2.IMREAD_UNCHANGED)[::-1]
    rows, columns = np.nonzero(pixels[:, :, 3])
    assert (len(rows), pixels.shape) == (1, (400, 400, 4))
    assert view.x + columns[0] * CELL <= 5.05 < view.x + (columns[0] + 1) * CELL
    assert view.y + rows[0] * CELL <= -2.95 < view.y + (rows[0] + 1) * CELL
    high = cloud_from_above(points[:1], HERE, base)
    assert high.png == view.png


def test_ages_and_paths() -> None:
    pixels = cv2.imdecode(np.frombuffer(ages_image(np.array([[0, 100], [-1, 5]], np.int8)), np.uint8), -1)
    assert pixels.tolist() == [[255, 5], [0, 100]]
    positions = np.arange(2000.0).reshape(1000, 2)
    thin = path_points(positions, 500)
    assert len(thin) == 500 and thin[0, 0] == 0.0 and thin[-1, 1] == 1999.0
    assert path_points(positions[:3], 500) is not None and len(path_points(positions[:3], 500)) == 3


def transform(child: str, x: float, parent: str = 'map', w: float = 1.0) -> Any:
    found = TransformStamped(child_frame_id=child)
    found.header.frame_id, found.transform.translation.x, found.transform.rotation.w = parent, x, w
    found.header.stamp.secs = 100
    return found


def test_what_tf_says() -> None:
    transforms = Transforms()
    transforms.take(TFMessage([transform('/base_link', 3.0), transform('bad', math.nan), transform('bad', 1.0, w=2.0)]),
                    False)
    transforms.take(TFMessage([transform('laser', 0.5, 'base_link')]), True)
    pose = transforms.pose('map', 'laser', 100.25)
    assert pose is not None and pose.translation.tolist() == [3.5, 0.0, 0.0] and pose.age == 0.25 and pose.yaw == 0.0
    assert transforms.pose('map', 'bad', 100.0) is None and transforms.pose('', 'laser', 100.0) is None
    same = transforms.pose('anything', '/anything', 100.0)
    assert same is not None and same.age is None


def test_frames_are_bounded() -> None:
    transforms = Transforms()
    transforms.take(TFMessage([transform('frame%d' % number, 0.0) for number in range(MAX_FRAMES + 1)]), False)
    assert transforms.pose('map', 'frame%d' % (MAX_FRAMES - 1), 100.0) is not None
    assert transforms.pose('map', 'frame%d' % MAX_FRAMES, 100.0) is None


def test_the_newest_lines_of_both_logs_once() -> None:
    log = LogEntries()
    for number in range(MAX_ENTRIES + 10):
        log.add(Log(level=Log.WARN, name='/node', msg='line %d\x1b' % number), 'robot')
    last, entries = log.after(0)
    assert len(entries) == MAX_ENTRIES and entries[0]['text'] == 'line 10?' and entries[0]['level'] == 'warn'
    log.add(Log(level=Log.WARN, name='/node', msg='line %d\x1b' % number), 'operator')
    assert log.after(last) == (last, [])
    log.add(Log(level=77, name='/node', msg='x' * 10000), 'operator')
    assert [len(entry['text']) for entry in log.after(last)[1]] == [500]


def test_the_state_of_a_robot() -> None:
    known = Known()
    assert overview_of('ugv1', known, 10.0)['level'] == 'stale'
    assert state_of(known, '/operator_receiver', 10.0)['link']['paths'] == []
    known.status = RobotStatus(driver='/operator_receiver', profiles=['explore'], problems=['a: b\x07'])
    known.link, known.linked, known.heard = LinkStatus(loss=math.nan, sent=2.0, rate=3.0), 9.5, 9.75
    known.gas['gas'] = math.inf
    state = state_of(known, '/operator_receiver', 10.0)
    assert (state['level'], state['silence'], state['mine'], state['problems']) == ('warn', 0.25, True, ['a: b?'])
    assert (state['link']['loss'], state['link']['sent'], state['link']['age']) == (None, 2.0, 0.5)
    assert state['gas'] == [{'name': 'gas', 'value': None, 'unit': ''}]
    known.status.problems, known.status.profiles = ['x' * 10000] * 1000, ['y' * 10000] * 1000
    state = state_of(known, '/operator_receiver', 10.0)
    assert sum(map(len, state['problems'] + state['profiles'])) == 2 * MAX_TEXTS * MAX_TEXT
    known.status.estop, known.status.driver = True, '/operator_receiver2'
    state = state_of(known, '/operator_receiver', 10.0)
    assert (state['level'], state['estop'], state['mine']) == ('error', True, False)


def test_captures_are_listed_and_nothing_else_is_read(tmp_path) -> None:
    for name in ('ugv1_thermal_1.png', 'ugv1_thermal_1.yaml', 'ugv2_lidar.pcd', '.hidden.png', 'secret.key'):
        (tmp_path / name).write_text('content')
    (tmp_path / 'ugv1_link.png').symlink_to('/etc/passwd')
    names = {one['name'] for one in listed(str(tmp_path), 'ugv1')}
    assert names == {'ugv1_thermal_1.png', 'ugv1_thermal_1.yaml'}
    assert listed('', '') == [] and listed(str(tmp_path / 'none'), '') == []
    assert path_of(str(tmp_path), 'ugv1', 'ugv1_thermal_1.png')
    for name in ('ugv2_lidar.pcd', 'ugv1_link.png', '../ugv1_thermal_1.png', 'secret.key', 'ugv1_none.png', ''):
        assert not path_of(str(tmp_path), 'ugv1', name)


