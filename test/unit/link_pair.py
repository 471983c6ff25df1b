# SPDX-License-Identifier: BSD-3-Clause
"""Transports of a link in one process, on the loopback device."""
import contextlib
import threading
from typing import Any, Callable, Iterator, List, Tuple

import numpy as np
from polling import WAIT

from smokebot_udp.link.transport import LinkTransport, OperatorTransport, RobotTransport
from smokebot_udp.udpros.frame import Frame

KEY = bytes(range(32))


class Told(List[str]):
    """Keeps what a transport reports and logs."""

    def __call__(self, text: str) -> None:
        self.append(text)


class Links:
    """Makes transports, and closes them."""

    def __init__(self, key: bytes = KEY) -> None:
        self.key = key
        self.made: List[LinkTransport] = []

    def robot(self, port: int = 0, **options: Any) -> Tuple[RobotTransport, Told]:
        """A robot and what it reports."""
        told = Told()
        options = {'name': '/robot_sender@ugv1', 'key': self.key, 'report': told, 'log': lambda _: None, **options}
        robot = RobotTransport(port, options.pop('key'), **options)
        self.made.append(robot)
        return robot, told

    def operator(self, port: int, name: str = '/operator_receiver@desk1', **options: Any) -> Tuple[
            OperatorTransport, Told]:
        """An operator of the robot at a port of some hosts, and what it reports."""
        told = Told()
        hosts = options.pop('hosts', ['127.0.0.1'])
        options = {'name': name, 'key': self.key, 'report': told, 'log': lambda _: None, **options}
        operator = OperatorTransport([(host, port) for host in hosts], options.pop('key'), **options)
        self.made.append(operator)
        return operator, told

    def close(self) -> None:
        for one in self.made:
            one.close()


@contextlib.contextmanager
def links(key: bytes = KEY) -> Iterator[Links]:
    """Links that end with the block."""
    made = Links(key)
    try:
        yield made
    finally:
        made.close()


class Inbox:
    """Callbacks that keep what they are called with."""

    def __init__(self) -> None:
        self.messages: List[Any] = []
        self.records: List[bytes] = []
        self.arrivals: List[Tuple[int, int, int, int, float, int]] = []
        self._new = threading.Condition()

    def message(self, message: Any) -> None:
        with self._new:
            self.messages.append(message)
            self._new.notify_all()

    def batch(self, records: Any, mask: Any) -> None:
        with self._new:
            self.records += [record.tobytes() for record in records[mask]]
            self._new.notify_all()

    def arrived(self, *what: Any) -> None:
        self.arrivals.append(what)  # type: ignore[arg-type]

    def wait(self, condition: Callable[[], Any]) -> None:
        with self._new:
            assert self._new.wait_for(condition, WAIT)


def frame(message_class: Any, count: int, size: int, field: str = 'data') -> Frame:
    """A frame whose messages differ in each byte of a field."""
    made = Frame(message_class, count, {field: size})
    made.records[field] = np.random.RandomState(size).randint(0, 256, (count, size)).astype(np.uint8)
    return made
