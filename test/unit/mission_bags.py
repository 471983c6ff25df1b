# SPDX-License-Identifier: BSD-3-Clause
"""Bags of a mission of 20 s, written by hand, whose numbers are known.

By the robot's clock, which begins at START: images of `thermal` at 10 Hz with the numbers 0 to 199, each published to
the operator 0.2 s later, but not those from 8 s to 12 s: the link was cut. `gas` has no stamps and is cut, too. The
operator's clock is OFFSET behind. The focus is `default` until 5 s, then `inspection`; desk drives from 5 s on, and the
emergency stop is engaged from 14 s to 16 s. The robot drives 0.2 m in each second.
"""
import json
import pathlib
from typing import Any, Dict, List, Sequence, Tuple

import numpy as np
import rosbag
import rospy
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Image
from std_msgs.msg import Float32, Float64, Header, String

from smokebot_udp.mission_report.record import LOAD_PERIOD
from smokebot_udp.msg import LinkStatus, PathStatus, RobotStatus, StreamStatus

START, DURATION, OFFSET, DELAY = 1000.0, 20.0, 3.0, 0.2
CUT = 8.0, 12.0
"""[s]"""

TOPICS = {'robot': {'thermal': '/thermal/image_raw', 'gas': '/gas', 'odom': '/odom', 'status': '/robot_sender/status',
                    'link': '/robot_sender/link'},
          'operator': {'thermal': '/desk/operator/thermal/image_raw', 'gas': '/desk/operator/gas'}}

Messages = List[Tuple[str, Any, float]]
"""[(topic, message, time)]"""


def header(time: float) -> Any:
    return Header(stamp=rospy.Time.from_sec(round(time, 3)))


def image(number: int) -> Any:
    """A gradient whose columns move with the number."""
    pixels = np.tile(np.arange(16, dtype=np.uint16) * 1000 + number, (12, 1))
    return Image(header=header(START + 0.1 * number), height=12, width=16, step=32, encoding='mono16',
                 data=pixels.tobytes())


def description(side: str, namespace: str = '/') -> Any:
    kinds = {'thermal': 'image'}
    return String(json.dumps({'side': side, 'namespace': namespace, 'streams': {
        name: {'type': kinds.get(name, 'relay'), 'to_robot': False, 'topics': [topic]}
        for name, topic in TOPICS[side].items()}}))


def status(time: float, focus: str, driver: str, estop: bool, enabled: bool = True) -> Tuple[str, Any, float]:
    return TOPICS['robot']['status'], RobotStatus(
        header=header(START + time), focus=focus, driver=driver, estop=estop,
        streams=[StreamStatus(name='thermal', enabled=enabled, rate=10.0)]), START + time


def link(time: float) -> Tuple[str, Any, float]:
    return TOPICS['robot']['link'], LinkStatus(
        header=header(START + time), rate=4.0, sent=2.0, capacity=8.0, loss=0.25, queue_delay=0.05,
        round_trip=0.1, paths=[PathStatus('wlan0', 1.5, 6.0, 0.2, 0.05), PathStatus('wwan0', 0.5, 2.0, 0.3, 0.05)]
        if time >= 10 else []), START + time


def robot() -> Messages:
    topics = TOPICS['robot']
    found: Messages = [('/robot_black_box/description', description('robot'), START)]
    found += [(topics['thermal'], image(number), START + 0.1 * number) for number in range(200)]
    found += [(topics['gas'], Float32(0.5), START + number) for number in range(20)]
    found += [link(second) for second in range(20)]
    found += [status(0, 'default', '', False), status(5, 'inspection', 'desk', False),
              status(14, 'inspection', 'desk', True), status(16, 'inspection', 'desk', False)]
    for number in range(41):
        odometry = Odometry(header=header(START + 0.5 * number))
        odometry.pose.pose.position.x = 0.1 * number
        found.append((topics['odom'], odometry, START + min(0.5 * number, 19.9)))
    return found


def operator(namespace: str = '/') -> Messages:
    topics = TOPICS['operator']
    begun = START - OFFSET
    found: Messages = [('/desk/operator_black_box/description', description('operator', namespace), begun)]
    found += [(topics['thermal'], image(number), begun + 0.1 * number + DELAY) for number in range(198)
              if not CUT[0] <= 0.1 * number < CUT[1]]
    found += [(topics['gas'], Float32(0.5), begun + number + DELAY) for number in range(20)
              if not CUT[0] <= number < CUT[1]]
    found += [('/desk/operator_receiver/clock_offset', Float64(OFFSET), begun + second) for second in range(1, 20)]
    found += [('/desk/operator/control', String('in control'), begun + 6.0)]
    return found


def loads(side: str, load: float, begin: float = 0.0, end: float = DURATION) -> Messages:
    """What a side's black box tells of its machine, by its own clock.

    :param begin, end: when it does [s]
    """
    start = START - (OFFSET if side == 'operator' else 0.0)
    name = '/robot_black_box' if side == 'robot' else '/desk/operator_black_box'
    return [(name + '/load', Float64(load), start + time) for time in np.arange(begin, end, LOAD_PERIOD).tolist()]


def write(path: pathlib.Path, messages: Sequence[Tuple[str, Any, float]], **options: Any) -> str:
    """A bag; its path."""
    with rosbag.Bag(str(path), 'w', **options) as bag:
        for topic, message, time in sorted(messages, key=lambda one: one[2]):
            bag.write(topic, message, rospy.Time.from_sec(time))
    return str(path)


def both(folder: pathlib.Path) -> Dict[str, str]:
    """{side: path of its bag}"""
    return {'robot': write(folder / 'a.bag', robot()), 'operator': write(folder / 'b.bag', operator())}
