# SPDX-License-Identifier: BSD-3-Clause
"""What `check` finds; integration/wrong_streams.test runs it."""
from typing import Any, Dict, List, Optional, Tuple

import pytest

from smokebot_udp.long_messages import REMEDY
from smokebot_udp.monitoring import check
from smokebot_udp.monitoring.check import Checked, Cost, Finding, Heard
from smokebot_udp.monitoring.sources import LISTENER, SERVICE, TOPIC, Graph, Source
from smokebot_udp.monitoring.status import ERROR, OK, WARN

GRAPH = Graph({'/scan': ['/sick']}, {'/scan': 'sensor_msgs/LaserScan'}, {'/lamp': ['/z']}, {'/cmd_vel': ['/base']})
SCAN = Source(TOPIC, '/scan', 'sensor_msgs/LaserScan')
GOOD = Heard(10.0, 4000.0, 0.01, 'laser', True)


def scan(**fields: Any) -> Checked:
    return Checked(**{'name': 'scan', 'settings': {'type': 'scan', 'rate': 5.0}, 'source': SCAN,
                      'steady': True, 'heard': GOOD, **fields})


def relay(settings: Optional[Dict[str, Any]] = None, **fields: Any) -> Checked:
    return scan(settings={'type': 'relay', 'rate': 5.0, 'reliable': False, **(settings or {})}, **fields)


def judged(stream: Checked) -> List[Tuple[int, str]]:
    return [(finding.level, finding.text) for finding in check.judge(stream, GRAPH, ['lost'])]


@pytest.mark.parametrize('stream, found', [
    (scan(), []),
    (scan(heard=Heard()), [(ERROR, '/sick publishes /scan, but nothing comes')]),
    (scan(heard=Heard(), steady=False), []),
    (scan(heard=Heard(), source=SCAN._replace(name='/scn')), [(ERROR, 'nobody publishes /scn; similar: /scan')]),
    (scan(heard=Heard(), source=SCAN._replace(name='/scn'), steady=False),
     [(WARN, 'nobody publishes /scn; similar: /scan')]),
    (relay(heard=Heard(), source=Source(TOPIC, '/robot_sender/link')), []),     # it does not run yet
    (relay(heard=Heard(), source=Source(TOPIC, '/diagnostics'), steady=False), []),
    (scan(heard=GOOD._replace(age=12.34)), [(WARN, "its stamps are 12.3 s behind this machine's clock")]),
    (scan(heard=GOOD._replace(age=-60.0)), [(WARN, "its stamps are 60.0 s ahead of this machine's clock")]),
    (scan(heard=GOOD._replace(age=60.0), steady=False), []),
    (scan(heard=GOOD._replace(age=None)),
     [(WARN, 'its messages have no stamp: their age counts from their arrival at robot_sender')]),
    (scan(heard=GOOD._replace(frame='')), [(WARN, 'its messages have no frame_id: rviz cannot place them')]),
    (scan(heard=GOOD._replace(frame='lost')),
     [(WARN, "tf knows no way from its frame 'lost' to the fixed frame: rviz cannot place it")]),
    (scan(failure='its ranges are 5'), [(ERROR, 'a message cannot be sent: its ranges are 5')]),
    (relay(heard=GOOD._replace(size=300000.0)),
     [(WARN, 'its messages take 215 datagrams each, and are lost with any of them; ' + REMEDY)]),
    (relay({'reliable': True}, heard=GOOD._replace(size=300000.0)), []),
    (relay(heard=GOOD._replace(frame='lost', size=100.0)), []),
    (scan(source=SCAN._replace(type='a/B')), [(ERROR, '/scan is published as sensor_msgs/LaserScan, must be a/B')]),
    (scan(source=Source(LISTENER, '/cmd_vel'), heard=Heard(), steady=False), []),
    (scan(source=Source(LISTENER, '/cmd_vl'), heard=Heard(), steady=False),
     [(WARN, 'nobody on the robot listens to /cmd_vl; similar: /cmd_vel')]),
    (relay(source=Source(TOPIC, '/robot_sender/status'), heard=GOOD._replace(size=3000.0)),
     [(ERROR, 'nobody publishes /robot_sender/status')][:0]),
    (scan(source=Source(SERVICE, '/lamp'), heard=Heard()), []),
    (scan(source=Source(SERVICE, '/lmp'), heard=Heard()),
     [(ERROR, 'the robot has no service /lmp; similar: /lamp')])])
def test_a_stream(stream: Checked, found: List[Tuple[int, str]]) -> None:
    assert judged(stream) == found


def test_the_link() -> None:
    image = scan(settings={'type': 'image', 'rate': 5.0}, cost=Cost(100.0, 2000.0))
    streams = [image, scan(cost=Cost(900.0, 900.0)), scan()]
    assert check.judge_link(streams, None) == [Finding(
        OK, 'link', 'the streams take 1 Mbit/s at least, and more makes images sharper; give its capacity by --link '
        'MBIT')]
    assert check.judge_link(streams, 2e3)[0].text == (
        'the streams take 1 Mbit/s at least, it carries 2 Mbit/s: images share 1.1 Mbit/s of it')
    assert check.judge_link(streams[1:], 2e3)[0].text == 'the streams take 900 kbit/s at least, it carries 2 Mbit/s'
    assert check.judge_link(streams, 999.0)[0].level == ERROR and check.judge_link(streams, 1e3)[0].level == OK


def test_the_machine_and_services() -> None:
    assert not check.judge_buffer(4 << 20, 4 << 20)
    found, = check.judge_buffer(212992, 4 << 20)
    assert found.level == WARN and found.text.endswith('sudo sysctl -w net.core.rmem_max=8388608')
    assert not check.judge_service_type('lamp', 'a/B', 'a/B')
    assert check.judge_service_type('lamp', 'a/C', 'a/B')[0].text == 'its service is a/C, must be a/B'
    assert check.judge_service_type('lamp', None, 'a/B')[0].level == ERROR
    assert check.is_there(Source(SERVICE, '/lamp'), GRAPH) and not check.is_there(SCAN, GRAPH)


def test_the_report_has_the_worst_first_and_a_line_for_each_stream() -> None:
    assert check.lines([Finding(WARN, 'a', 'x'), Finding(ERROR, 'b', 'y'), Finding(OK, 'c', 'z')]) == [
        'ERROR  b: y', 'WARN   a: x', 'OK     c: z', 'errors: 1, warnings: 1']
    lines = check.table([scan(cost=Cost(19.2, 12345.0)), scan(name='lost', heard=Heard())], {'scan': 'obstacles'})
    assert [line.split() for line in lines[1:]] == [
        ['scan', 'scan', 'obstacles', '10', '5', '4', '10', '19.2', '12345'],
        ['lost', 'scan', *7 * ['-']]]


def test_long_names_are_whole_and_the_columns_stay_in_line() -> None:
    name = 'front_left_thermal_camera'
    heading, first, second = check.table([scan(name=name), scan()], {})
    assert first.startswith(name + ' scan ') and second.index('scan', 5) == heading.index('TYPE') == len(name) + 1
