# SPDX-License-Identifier: BSD-3-Clause
"""How long a map takes over an emulated link, by the package's streams and as a PNG in fragments; without a network."""
import math
from typing import Any, Iterable, Iterator, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from smokebot_udp.arrays import Array, Records
from smokebot_udp.codecs.wire.grid import UNKNOWN
from smokebot_udp.link_lab.channel import Channel, LinkConditions
from smokebot_udp.mission.parameters import check
from smokebot_udp.mission.settings import Settings
from smokebot_udp.streams.air import Air
from smokebot_udp.streams.grid.encoder import GridEncoder
from smokebot_udp.streams.held import Holding
from smokebot_udp.streams.outlook import Outlook
from smokebot_udp.streams.segments import MAIN_PART, TILES
from smokebot_udp.udpros.datagram import IP_UDP_HEADERS
from smokebot_udp.udpros.frame import Frame

from .linked_encoder import LinkedEncoder
from .maps import map_message
from .offline_link import MAX_DATAGRAM_SIZE, operator_side, work_off

STEP = 0.005
"""Step of the simulated time [s]."""
DELAY = 0.02
"""Delay of the link, one way [s]."""
AHEAD = 0.01
"""Datagrams wait at the robot until the link's queue is shorter than this [s]."""
REPORT, REPORT_IDLE = 0.1, 1.0
"""Time between reports of what is held: while tiles arrive, and otherwise [s]."""
RATE = 10.0
"""Maximum rate of the maps that are shown [Hz]."""
OPERATOR = '/operator'
FRAGMENT = 1460
"""Size of a fragment of a PNG in a datagram [byte]."""


class Outcome(NamedTuple):
    """What became of a map."""
    first: float
    """Time until anything of the map was shown [s]; inf: never."""
    complete: float
    """Time until the map was shown as well as it can be [s]; inf: not in time."""
    sent: int
    """Size of what the link carried until then [byte on the air]."""


class _Datagram(NamedTuple):
    record: Records
    """(1,)"""
    part: str
    """Name of the part of the stream."""
    size: int
    """Size on the air [byte]."""


class MapTransfer:
    """A robot's and an operator's side of a grid stream with a link between them.

    :param coding: of the stream
    :param rate: what the link leaves to the map [bit/s]
    :param loss: packet-loss ratio both ways; the robot knows it
    :param seed: of the losses
    """

    def __init__(self, coding: str, rate: float, loss: float, seed: int) -> None:
        self._now = 0.0
        self._settings = Settings(check({'robot_topic': 'unused', 'coding': coding, 'max_bitrate': rate / 1e3},
                                        GridEncoder.PARAMETERS))
        self._encoder = LinkedEncoder(
            GridEncoder(self._settings.requested, clock=lambda: self._now, session=lambda: seed + 1),
            operators=lambda part: (OPERATOR,), outlook=Outlook(Air({loss: 1.0}, None, True)))
        self._assembler, self._shown_settings = operator_side('grid', rate=RATE)
        self._forth = Channel(LinkConditions(loss=loss, delay=DELAY, rate=rate, queue=1.0), '%d forth' % seed)
        self._back = Channel(LinkConditions(loss=loss, delay=DELAY), '%d back' % seed)
        self._seq = 0
        self._waiting: List[_Datagram] = []
        self._flying: List[Tuple[float, _Datagram]] = []
        self._reports: List[Tuple[float, Holding]] = []
        self._repeat_at, self._reported, self._news = math.inf, -math.inf, False

    def show(self, cells: Array, limit: float) -> Outcome:
        """Send a map until it is complete, for `limit` [s] at most."""
        begun, sent, first = self._now, self._forth.counts.carried, math.inf
        self._queue(self._encoder.encode(map_message(cells), self._settings, MAX_DATAGRAM_SIZE))
        while self._now < begun + limit:
            self._now += STEP
            for message, completeness in self._turn():
                first = min(first, self._now - begun)
                if self._complete(message, completeness, cells):
                    return Outcome(first, self._now - begun, self._forth.counts.carried - sent)
        return Outcome(first, math.inf, self._forth.counts.carried - sent)

    def follow(self, messages: Iterable[Any], period: float) -> List[float]:
        """Send one map after the other, `period` [s] apart. How much of each the operator is shown at the end of its
        time: the share of its known cells that are right, 0..1; none, where the map shown lies elsewhere.

        :param messages: nav_msgs/OccupancyGrid
        """
        shares: List[float] = []
        shown: Any = None
        for sent in messages:
            self._queue(self._encoder.encode(self._encoder.merge(None, sent), self._settings, MAX_DATAGRAM_SIZE))
            until = self._now + period
            while self._now < until:
                self._now += STEP
                shown = next((message for message, _ in self._turn()), shown)
            cells = np.asarray(sent.data, np.int8)
            known = cells != UNKNOWN
            here = shown is not None and shown.info.origin == sent.info.origin and len(shown.data) == len(cells)
            shares.append(float((shown.data[known] == cells[known]).mean()) if here else 0.0)
        return shares

    def settle(self, duration: float) -> int:
        """Go on with the same map [s]; what is sent [byte on the air]."""
        sent, until = self._forth.counts.carried, self._now + duration
        while self._now < until:
            self._now += STEP
            for _ in self._turn():
                pass
        return self._forth.counts.carried - sent

    def _complete(self, message: Any, completeness: float, cells: Array) -> bool:
        """The interleaved map is reduced; it is complete when all of it arrived."""
        if self._settings['coding'] == 'interleaved':
            return completeness >= 1.0
        return np.array_equal(np.asarray(message.data, np.int8), cells.ravel())

    def _turn(self) -> Iterator[Tuple[Any, float]]:
        """One step: send, receive, report; the maps that are shown."""
        if self._now >= self._repeat_at and not self._waiting:
            self._queue(self._encoder.repeat(self._settings, MAX_DATAGRAM_SIZE))
        while self._waiting and self._forth.waits(self._now) < AHEAD:
            datagram = self._waiting.pop(0)
            self._flying += [(at, datagram) for at in self._forth.fate(self._now, datagram.size)]
        landed = [item for item in self._flying if item[0] <= self._now]
        self._flying = [item for item in self._flying if item[0] > self._now]
        for _, (record, part, _) in landed:
            self._news |= part == TILES
            self._assembler.receive(record, np.ones(1, bool), self._now, part)
        work_off(self._assembler)
        self._report()
        finished = self._assembler.poll(self._now)
        assembled = finished and self._assembler.assemble(finished, self._shown_settings, False, self._now)
        if assembled:
            yield assembled.message, assembled.completeness

    def _queue(self, frames: Sequence[Frame]) -> None:
        """Number datagrams as a publisher does, and let them wait for the link."""
        for frame in frames:
            part = TILES if frame.message_class is self._assembler.SEGMENTS[TILES] else MAIN_PART
            for row in range(len(frame)):
                record, self._seq = frame.records[row:row + 1].copy(), self._seq + 1
                record['header']['seq'] = self._seq
                self._waiting.append(_Datagram(record, part, frame.datagram_size + IP_UDP_HEADERS))
        period: Optional[float] = self._encoder.repeat_period(self._settings)
        self._repeat_at = math.inf if period is None else self._now + period

    def _report(self) -> None:
        holding = self._assembler.holding()
        if holding is not None and self._now - self._reported >= (REPORT if self._news else REPORT_IDLE):
            self._news, self._reported = False, self._now
            self._reports += [(at, holding) for at in self._back.fate(self._now, 100)]
        for _, report in [item for item in self._reports if item[0] <= self._now]:
            self._encoder.held(OPERATOR, report)
            self._repeat_at = self._now
        self._reports = [item for item in self._reports if item[0] > self._now]


def fragments(size: int, rate: float, loss: float, seed: int, limit: float, whole: bool) -> Outcome:
    """A file in datagrams, sent again and again without a pause.

    :param size: of the file [byte]
    :param whole: whether all fragments must be of one round, as those of a UDP message are; else of any
    """
    count = -(-size // FRAGMENT)
    channel = Channel(LinkConditions(loss=loss, delay=DELAY, rate=rate, queue=1.0), seed)
    have, now = np.zeros(count, bool), 0.0
    while now < limit:
        if whole:
            have[:] = False
        for index in range(count):
            for at in channel.fate(now, FRAGMENT + 12 + IP_UDP_HEADERS):
                have[index] = True
                if have.all():
                    return Outcome(at, at, channel.counts.carried)
            now += channel.waits(now)
    return Outcome(math.inf, math.inf, channel.counts.carried)
