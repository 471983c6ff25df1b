#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""/diagnostics of both sides at 20 % loss, with an operator's clock that is an hour slow."""
import contextlib
import json
import math
import pathlib
import re
import subprocess
import sys
import threading
import unittest
from typing import Any, Dict, List, Optional, Tuple

import numpy as np
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import Image
from std_msgs.msg import Float32

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from waiting import Collector, ticks, undisturbed, wait_for

from smokebot_udp.codecs.display.view import COLOURS, FRESH, FROZEN

OK, WARN, ERROR = 0, 1, 2
RATE = 10.0
"""Rate of the camera [Hz]."""
NEAR = re.compile(r'(9|10)\.\d|11\.0')
"""RATE as it is shown, about."""


class Camera(threading.Thread):
    """Publishes images while it is on, and gas all the time."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.on = True
        self._images = rospy.Publisher('/thermal/image_raw', Image, queue_size=1)
        self._gas = rospy.Publisher('/gas', Float32, queue_size=1)
        self._message = Image(height=120, width=160, encoding='mono16', step=320,
                              data=np.random.RandomState(0).bytes(120 * 320))

    def run(self) -> None:
        with contextlib.suppress(rospy.ROSException):   # the topics are closed: the test has ended
            self._publish()

    def _publish(self) -> None:
        for _ in ticks(RATE):
            self._gas.publish(0.5)
            if self.on:
                self._message.header.stamp = rospy.Time.now()
                self._images.publish(self._message)


def link_top(*arguments: str) -> str:
    """What link_top prints once; empty: nothing came in time."""
    return subprocess.run(['rosrun', 'smokebot_udp', 'link_top', '--once', *arguments], timeout=60,
                          stdout=subprocess.PIPE).stdout.decode()


class Diagnostics(unittest.TestCase):
    statuses: Dict[str, Any]

    @classmethod
    def setUpClass(cls) -> None:
        rospy.init_node('test_diagnostics')
        cls.statuses = {}
        rospy.Subscriber('/diagnostics', DiagnosticArray, cls.take, queue_size=20)
        cls.view = Collector('/operator/thermal/image_color', Image)
        cls.camera = Camera()
        cls.camera.start()

    @classmethod
    def take(cls, message: Any) -> None:
        cls.statuses.update((status.name, status) for status in message.status)

    def status(self, name: str, level: int, saying: str = '', **limits: Tuple[float, float]) -> Dict[str, str]:
        """The {key: text} of a status as soon as it has this level, and each value is within its (least, most).

        :param saying: what its message must contain
        :param limits: by the values' names, with _ for blanks and without units
        """
        def found() -> Any:
            status = self.statuses.get(name)
            if status is None or status.level != level or saying not in status.message:
                return None
            values = {pair.key.split(' [')[0].replace(' ', '_'): pair.value for pair in status.values}
            good = all(key in values and least <= float(values[key]) <= most for key, (least, most) in limits.items())
            return good and {**values, 'message': status.message}
        try:
            values: Dict[str, str] = wait_for(found, what='%s with level %d, %r and %s' % (name, level, saying, limits))
            return values
        except AssertionError as error:
            raise AssertionError('%s; it is\n%s' % (error, self.statuses.get(name))) from None

    @undisturbed()
    def test_a_stream_shows_its_rates_its_loss_and_its_age(self) -> None:
        robot = self.status('robot_sender: thermal', OK, rate_in=(9, 11), rate_out=(9, 11))
        self.assertEqual((robot['side'], robot['topic']), ('robot', '/thermal/image_raw'))
        # the loss is above its threshold; ages are by the robot's clock, an hour ahead
        operator = self.status('operator_receiver: thermal', WARN, rate_out=(9, 11), loss=(15, 25),
                               completeness=(65, 95), age_p50=(0, 400), age_p99=(0, 2000))
        self.assertIn('% lost', operator['message'])
        # emulated losses are none of the kernel's, which drops what comes while the node waits for the processor
        self.status('operator_receiver: thermal', WARN, kernel_drops=(0, float(operator['kernel_drops'])),
                    lost=(float(operator['lost']) + 50, math.inf))
        self.status('operator_receiver: gas', OK, rate_out=(6, 10))

        def part_that_came() -> float:
            """The rates are those of different moments."""
            sent, came = (float(self.status('%s: thermal, %s' % (one, other), level)['datagrams/s'])
                          for one, other, level in (('robot_sender', '/operator_receiver', OK),
                                                    ('operator_receiver', '/robot_sender', WARN)))
            return came / sent
        wait_for(lambda: 0.7 < part_that_came() < 0.9, what='four fifths of the datagrams')

    def test_the_robots_clock_is_known(self) -> None:
        clock = self.status('operator_receiver: clock', OK, offset=(3.5999e6, 3.6001e6), round_trip=(0, 1000))
        self.assertLess(abs(float(clock['offset']) - 3.6e6), float(clock['uncertainty']) + 5.0)

    def test_invalid_settings_are_reported_and_set_back(self) -> None:
        rospy.set_param('/robot_sender/thermal/rate', -5)
        message = self.status('robot_sender: settings', WARN, problems=(2, 2))['message']
        self.assertIn('/robot_sender/thermal/rate refused, 10.0 stays: rate is -5', message)
        wait_for(lambda: rospy.get_param('/robot_sender/thermal/rate') == 10.0, what='the old rate')
        rospy.set_param('/robot_sender/focus', 'nonsense')
        values = self.status('robot_sender: settings', WARN, problems=(3, 3))
        self.assertIn("focus is 'nonsense'", values['message'])
        self.assertIn("warn_loss is 'much'", values['problem_1'])
        self.status('robot_sender: thermal', OK, rate_out=(9, 11))

    def test_a_silent_camera_is_an_error_on_both_sides_and_looks_frozen(self) -> None:
        self.view.wait_connected()
        wait_for(lambda: self.frame() == COLOURS[FRESH], what='a fresh image')
        self.camera.on = False
        try:
            self.status('robot_sender: thermal', ERROR, 'its source is silent')
            self.status('operator_receiver: thermal', ERROR, 'nothing is shown')
            wait_for(lambda: self.frame() == COLOURS[FROZEN], what='a frozen image')
        finally:
            self.camera.on = True
        wait_for(lambda: self.frame() == COLOURS[FRESH], what='a fresh image again')
        self.status('robot_sender: thermal', OK, rate_out=(9, 11))
        self.status('operator_receiver: gas', OK)

    def frame(self) -> Optional[Tuple[int, ...]]:
        """The colour (b, g, r) of the view's frame."""
        message = list(self.view.messages.values())[-1] if self.view.messages else None
        return message and tuple(np.frombuffer(message.data, np.uint8)[:3].tolist())

    def test_link_top_prints_both_sides(self) -> None:
        self.status('robot_sender: thermal', OK, rate_in=(9, 11))
        self.status('operator_receiver: thermal', WARN, rate_out=(9, 11))

        def shown() -> List[str]:
            """The line of the stream; its rates are those of another moment than what is awaited elsewhere."""
            lines = [line.split() for line in link_top('--wait', '20').splitlines()]
            good = [line for line in lines if line[1:2] == ['thermal'] and all(map(NEAR.fullmatch, line[2:6]))]
            return good[0] if good else []
        self.assertEqual(wait_for(shown, 60, 'the rates of the camera')[0], 'WARN')

    def test_link_top_prints_json(self) -> None:
        def printed() -> Any:
            text = link_top('--json', '--wait', '20')
            tree = json.loads(text) if text else {}
            thermal = [stream for stream in tree.get('streams', []) if stream['stream'] == 'thermal']
            return thermal and thermal[0]['source_hz'] and thermal[0]['shown_hz'] and tree
        tree = wait_for(printed, 60, 'the rates of the camera')
        self.assertEqual(([robot['node'] for robot in tree['robots']], [one['node'] for one in tree['operators']]),
                         (['/robot_sender'], ['/operator_receiver']))
        self.assertGreater(tree['time'], 1e9)

    def test_link_top_shows_what_is_relayed_of_a_robot_whose_diagnostics_do_not_come(self) -> None:
        # it has a fixed time to find what is relayed, which a busy machine may need for its start; there, the link may
        # be slower for a moment, too
        def relayed() -> str:
            text = link_top('--wait', '6', '/diagnostics:=/diagnostics_elsewhere')
            good = re.search('^OK +link: ', text, re.M) and re.search(r'^OK +thermal +- +<=10\.0 ', text, re.M)
            if not good:
                print(text, file=sys.stderr)
            return text if good else ''
        text = wait_for(relayed, 60, 'what is relayed')
        head, link, control, wifi, _, thermal = text.splitlines()[:6]
        self.assertTrue(head.endswith(', no report of the operator'), text)
        self.assertRegex(link, r'^OK     link: .*; as /operator_receiver reports$')
        self.assertRegex(control, r'^OK     /\w+: /operator_receiver drives$')
        self.assertRegex(wifi, r'^OK     Wi-Fi of /\w+: ')
        self.assertEqual(thermal.split()[:4], ['OK', 'thermal', '-', '<=10.0'], text)


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'diagnostics', Diagnostics)
