# SPDX-License-Identifier: BSD-3-Clause
"""What the log says of commands that do not leave."""
from types import SimpleNamespace
from typing import Any, Callable, Iterator, List

import pytest
import rospy
from geometry_msgs.msg import Twist

from smokebot_udp.limited_log import ERROR_PERIOD
from smokebot_udp.nodes import operator_command
from smokebot_udp.nodes.operator_control import FROM_REST, IN_CONTROL, NO_COMMANDS, Outlook, free_state
from smokebot_udp.streams.config import load
from smokebot_udp.teleop.robot_clock import RobotTime

STREAM = """
streams:
  drive: {type: command, message_type: geometry_msgs/Twist, robot_topic: /cmd_vel, operator_topic: /operator/cmd_vel}
"""
REFUSAL = 'another operator drives'
LINE = "stream 'drive': commands are not sent: " + REFUSAL


class Sending:
    """A stream whose commands go nowhere, and time."""

    def __init__(self, monkeypatch: Any) -> None:
        self.refusal, self.now, self.releases = REFUSAL, 100.0, 0
        self.lines: List[str] = []
        callbacks: List[Callable[[Any], None]] = []
        topic = SimpleNamespace(publish=lambda message: None, unregister=lambda: None)

        def subscriber(name: str, class_: Any, callback: Callable[[Any], None], **_: Any) -> Any:
            callbacks.append(callback)
            return topic
        monkeypatch.setattr(rospy, 'Subscriber', subscriber)
        monkeypatch.setattr(rospy, 'logwarn', lambda text, *values: self.lines.append(text % values))
        monkeypatch.setattr(rospy, 'is_shutdown', lambda: False)
        monkeypatch.setattr('smokebot_udp.limited_log.time.monotonic', lambda: self.now)
        way: Any = SimpleNamespace(
            control=SimpleNamespace(session=1, loss=0.0, add_commands=lambda *_: None, outlook=lambda now: Outlook(
                self.refusal, RobotTime(1, 0, 0), self.releases)), view_age=lambda *_: None,
            transport=SimpleNamespace(publisher=lambda *_, **__: topic))
        self.stream = operator_command.OperatorCommand('drive', load(STREAM)[0]['drive'], way)
        self.stream.start()
        self._receive, = callbacks

    def command(self, after: float, refusal: str) -> None:
        """A command comes.

        :param after: the one before [s]
        :param refusal: why the robot takes none then; empty: it does
        """
        self.now += after
        self.refusal = refusal
        self._receive(Twist())


@pytest.fixture
def sending(monkeypatch: Any) -> Iterator[Sending]:
    made = Sending(monkeypatch)
    yield made
    made.stream.close()


def test_why_no_command_leaves_is_said_once(sending: Sending) -> None:
    for _ in range(100):
        sending.command(1.0, REFUSAL)
    assert sending.lines == [LINE]


def test_a_lock_that_comes_and_goes_fills_no_log_and_one_that_stays_is_told(sending: Sending) -> None:
    for number in range(200):
        sending.command(0.05, REFUSAL if number % 2 else '')
    assert 2 <= len(sending.lines) <= 1 + 10 / ERROR_PERIOD
    before = len(sending.lines)
    sending.command(0.1, '')
    for _ in range(100):
        sending.command(0.1, REFUSAL)
    assert len(sending.lines) == before + 1 and sending.lines[-1].startswith(LINE + ' (and ')


def test_after_a_stop_the_state_asks_for_a_command_at_rest_also_while_none_comes(sending: Sending) -> None:
    sending.command(0.1, '')
    assert free_state([sending.stream]) == IN_CONTROL == 'in control' and free_state([]) == NO_COMMANDS
    sending.releases += 1
    assert sending.stream.lock(sending.now + 60.0) is None     # nobody is asked to release a stick
    assert free_state([sending.stream]) == FROM_REST == 'in control: start at rest'
    sending.command(60.0, '')
    assert free_state([sending.stream]) == IN_CONTROL
