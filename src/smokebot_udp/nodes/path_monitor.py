# SPDX-License-Identifier: BSD-3-Clause
"""How long datagrams to the operators may be: the kernel's path MTU, and what the path drops without a word.

The robot's PathMonitor watches what is sent and reported, probes where that is doubtful (congestion/path_length.py),
and limits what the transport sends. The operator's PathAnswers says which probes came. What operators send is never
longer than what passes nearly everywhere: it is little.
"""
import contextlib
import threading
import time
from typing import Any, Dict, Optional, Sequence, Tuple

from ..congestion.path_length import ANSWER_BITS, SHORT, SHORT_PROBES, USUAL, PathLength
from ..msg import PathAnswer, PathProbe
from ..paths import Route
from ..transport import Transport
from ..udpros.datagram import IP_UDP_HEADERS
from ..udpros.endpoints import path_payload
from ..udpros.frame import Frame
from .opened import Part
from .outbox import Outbox

PROBES, ANSWERS = '/smokebot_udp/path/probe', '/smokebot_udp/path/answer'
"""Topics on the wire."""

MTU_PERIOD = 5.0
"""How often the kernel is asked [s]."""


class PathMonitor(Part):
    """The robot's side. All but `tick` and `close` are called in any thread.

    :param outbox: what is sent is charged there
    """

    def __init__(self, transport: Transport, outbox: Outbox) -> None:
        super().__init__()
        self._transport, self._outbox = transport, outbox
        self._longest = transport.max_datagram_size + transport.overhead
        self._paths: Dict[Tuple[str, int], PathLength] = {}     # by operator and path; replaced, not changed
        self._lock = threading.Lock()               # of the paths
        self._kernel, self._kernel_due = self._longest, 0.0
        self._publisher = self._opened.topic(transport.publisher(PROBES, PathProbe, whole=True))
        self._opened.topic(transport.subscriber(ANSWERS, PathAnswer, self._answered))

    def sent(self, stream: str, seq: int, count: int, size: int, now: float, route: Route) -> None:
        """Datagrams were sent, see outbox.Departed."""
        with self._lock:
            for (operator, index), path in self._paths.items():
                if index == int(operator in route.second):
                    path.sent(stream, route.limits.get(operator, count), size - IP_UDP_HEADERS, now)

    def reported(self, operator: str, report: Any, now: float, index: int = 0) -> None:
        """An operator's LinkReport about one of its paths came."""
        with self._lock:
            if (operator, index) in self._paths:
                self._paths[operator, index].reported({one.name: one.received for one in report.streams}, now)

    def _answered(self, answer: Any) -> None:
        with self._lock:
            for (operator, _), path in self._paths.items():     # each knows its probes by their numbers
                if operator == answer._connection_header['callerid']:
                    path.answered(answer.newest, answer.arrived, time.monotonic())

    @property
    def hole(self) -> Optional[int]:
        """Datagrams that are longer than this do not pass to all operators; None: all pass [byte of UDP payload]."""
        return min((path.length for path in self._paths.values() if path.hole), default=None)

    def tick(self, now: float) -> None:
        """Send the probes that are due, and limit what is sent to what passes."""
        connections = self._publisher.connections()
        self._follow(connections, now)
        for (operator, index), path in list(self._paths.items()):
            with self._lock:
                length = path.probe(now)
            if length is not None:
                self._probe(path, length, [operator] if index else [])
        if now >= self._kernel_due:
            self._kernel_due = now + MTU_PERIOD
            self._kernel = min([self._longest, *(_kernel_length(one['address'], self._longest) for one in connections)])
        length = min([self._kernel, *(path.length for path in self._paths.values())])
        self._transport.limit(length - self._transport.overhead)

    def _follow(self, connections: Any, now: float) -> None:
        used = self._transport.paths(now)
        names = {(connection['peer'], index) for connection in connections
                 for index in range(max(1, len(used.get(connection['peer'], ()))))}
        if names != self._paths.keys():
            with self._lock:
                self._paths = {name: self._paths.get(name) or PathLength(self._longest, now) for name in names}

    def _probe(self, path: PathLength, length: int, second: Sequence[str]) -> None:
        overhead = self._transport.overhead
        frames = [_frame(length - overhead, 1), _frame(SHORT - overhead, SHORT_PROBES)]
        first = self._publisher.publish_frames(*frames, second=second)
        with self._lock:
            path.probed(first)
        self._outbox.charge(1 + SHORT_PROBES, sum(len(frame) * frame.datagram_size for frame in frames))


class PathAnswers(Part):
    """The operator's side."""

    def __init__(self, transport: Transport) -> None:
        super().__init__()
        transport.limit(USUAL[-1] - transport.overhead)
        self._newest, self._arrived, self._source = 0, 0, None
        self._publisher = self._opened.topic(transport.publisher(ANSWERS, PathAnswer, queue_size=1))
        self._opened.topic(transport.subscriber(PROBES, PathProbe, self._probed))

    def _probed(self, probe: Any) -> None:
        """Answer; the transport's thread."""
        header, number = probe._connection_header, probe.header.seq     # one object for each connection
        if header is not self._source:
            self._source, self._newest, self._arrived = header, 0, 0
        if number > self._newest:
            self._arrived = (self._arrived << min(number - self._newest, ANSWER_BITS) | 1) & (1 << ANSWER_BITS) - 1
            self._newest = number
        elif self._newest - number < ANSWER_BITS:
            self._arrived |= 1 << self._newest - number
        self._publisher.publish(PathAnswer(newest=self._newest, arrived=self._arrived))


def _frame(size: int, count: int) -> Frame:
    """Probes whose datagrams have this size, as the transport counts it [byte]."""
    least = Frame(PathProbe, count, {'padding': 0})
    return Frame(PathProbe, count, {'padding': max(0, size - least.datagram_size)})


def _kernel_length(address: Tuple[str, int], longest: int) -> int:
    """The longest datagram that reaches an address unfragmented, as far as the kernel knows [byte of UDP payload]."""
    with contextlib.suppress(OSError):      # no route now
        return min(longest, path_payload(*address))
    return longest
