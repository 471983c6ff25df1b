# SPDX-License-Identifier: BSD-3-Clause
"""Reliable relays of diagnostics with `newest`: status by status, see reliable/carousel.py.

A DiagnosticArray of a node is 10 kB each second, of which little is news. What crosses are DiagnosticArrays of the
statuses that are due. The other side publishes all that it knows, once a second and when any comes.
"""
import threading
import time
from typing import Any, Dict, Optional, Sequence

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from ..limited_log import logerr
from ..packed import pack
from ..reliable.carousel import Carousel, Kept
from ..serialised import serialised
from .reliable_relay import Sink, TurnsSource
from .worker import PeriodicWorker

SHARE = 0.008
"""Share of the link's rate for statuses, to each peer: all statuses of a robot cross within 10 s at 0.3 Mbit/s, and
each second from about 3 Mbit/s on."""

PUBLISH_PERIOD = 1.0
"""Interval at which statuses are repeated: programs that show diagnostics take one for stale after 3 s to 5 s [s]."""

MAX_WAITING = 3
"""While this many messages wait for their acknowledgement, no status is sent."""

ENDED = 'no longer reported'


def ended(name: str) -> Any:
    """The status that says that another one of this name is no longer reported."""
    return DiagnosticStatus(level=DiagnosticStatus.STALE, name=name, message=ENDED)


def is_ended(status: Any) -> bool:
    """Whether a status says that it is no longer reported."""
    return bool(status.message == ENDED and status.level == DiagnosticStatus.STALE and not status.values)


class DiagnosticsSource(TurnsSource):
    """The side that sends."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._carousels: Dict[str, Carousel] = {}       # by peer
        self._head = b''        # serialised header of the newest array

    def _send(self, message: Any, source: str) -> None:
        peers, now = self._link.peers(), time.monotonic()
        statuses = [(status.name, status.level, serialised(status)) for status in message.status]
        with self._lock:
            self._head = serialised(message.header)
            self._carousels = {peer: self._carousels.get(peer) or _carousel() for peer in peers}
            for carousel in self._carousels.values():
                for status in statuses:
                    carousel.put(*status, now)
        self._nobody += not peers
        self._turns.wake()

    def _take_turns(self) -> None:
        """See TurnsSource."""
        channel, now = self._channel, time.monotonic()
        assert channel is not None
        rate, room = self._link.part_of_rate(SHARE), self._link.room
        with self._lock:
            due = {peer: carousel.take(rate, lambda states: len(self._array(states)), room, now)
                   for peer, carousel in self._carousels.items() if channel.waiting(peer) < MAX_WAITING}
            messages = {peer: self._array(states) for peer, states in due.items() if states}
        for peer, data in messages.items():
            channel.send(data, peer)

    def _array(self, states: Sequence[bytes]) -> bytes:
        """The packed DiagnosticArray of serialised statuses."""
        return pack(b''.join((self._head, len(states).to_bytes(4, 'little'), *states)))

    def _joined(self, peer: str) -> None:
        with self._lock:
            self._carousels.pop(peer, None)     # it knows nothing, whatever was sent to the one before

    def _given_up(self, peer: str, count: int, reason: str) -> None:
        super()._given_up(peer, count, reason)
        with self._lock:
            if peer in self._carousels:
                self._carousels[peer].renew()


def _carousel() -> Carousel:
    return Carousel(lambda name: serialised(ended(name)))


class DiagnosticsSink(Sink):
    """The side that receives."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._kept: Kept[Any] = Kept()
        self._header: Optional[Any] = None
        self._lock = threading.Lock()
        self._repeats = PeriodicWorker(self.name, self._repeat, self._report, PUBLISH_PERIOD)

    def start(self) -> None:
        """See WayBackStream."""
        super().start()
        self._opened.started(self._repeats)

    def _show(self, message: Any) -> None:
        now = time.monotonic()
        with self._lock:
            self._header = message.header
            for status in message.status:
                if is_ended(status):
                    self._kept.end(status.name, now)
                else:
                    self._kept.put(status.name, status, now)
        self._repeat()

    def _repeat(self) -> None:
        with self._lock:
            known = DiagnosticArray(header=self._header, status=self._kept.states(time.monotonic()))
        if known.status and not rospy.is_shutdown():
            self._topic.publish(self._rewrite(known))

    def _left(self, peer: str, reason: str) -> None:
        with self._lock:
            self._kept.clear()

    def _report(self, problem: Any) -> None:
        if not rospy.is_shutdown():
            logerr("stream '%s'" % self.name, problem)
