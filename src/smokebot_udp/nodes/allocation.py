# SPDX-License-Identifier: BSD-3-Clause
"""Gives the robot's streams their shares of the link, again and again, and turns them down to what these pay for."""
import math

from ..congestion.allocation import Allocator, DatagramSize, Demand, Thinning
from ..monitoring.windows import Rate

KBIT = 1e3 / 8
"""[byte/s]"""

OVER = 2.0
"""A source's rate is measured over so long [s]."""

PLANNED = 0.92
"""So much of the link is planned for: a picture that takes as long to leave as its successor to come, it cuts off."""

NEARLY = 0.95
"""A rate that is granted nearly as it is asked for, or as the source has it, is no limit."""


class Allocation:
    """Divides the link among streams.

    :param streams: {name: RobotStream}, started
    :param link: streams.base.Link, theirs
    """

    def __init__(self, streams, link):
        self._streams = {name: stream for name, stream in streams.items() if not stream.PROTECTED}
        self._relays = [stream for stream in streams.values() if stream.PROTECTED]
        self._link, self._outbox = link, link.outbox
        self._datagrams, self._thinning = DatagramSize(link.max_datagram_size), Thinning()
        self._allocator = Allocator()
        self._sources = {name: Rate(OVER) for name in self._streams}
        self._protected = Rate(OVER)
        self.wanted = math.inf
        """What all streams would send if the link had room for it [byte/s]."""
        self.shares = {}
        """{stream: what it has of the link [byte/s]}"""

    def divide(self, budget, now):
        """Divide anew; what levels leave over betters pictures.

        :param budget: [byte/s]; None: there is no limit
        :param now: by a steady clock [s]
        """
        unlimited = math.inf if budget is None else budget
        self._link.datagram_size = self._datagrams.follow(unlimited)
        demands = self._demands(now)
        self._protected.read(self._outbox.protected, now)
        protected = self._protected.per_second or 0.0
        self._thin(self._thinning.follow(unlimited, protected, now))
        self.wanted = protected + math.fsum(demand.levels[-1].cost for demand in demands.values())
        if budget is None:
            self.shares = {}
            for stream in self._streams.values():
                stream.grant({})
            return
        grants = self._allocator.allocate(budget, demands, protected, now)
        self.shares = {name: grant.share for name, grant in grants.items()}
        self._outbox.change(lambda pace: [pace.set_share(name, share) for name, share in self.shares.items()])
        spare = PLANNED * budget - protected - math.fsum(grant.cost for grant in grants.values())
        limited = [name for name, grant in grants.items() if grant.level is not None
                   and grant.level < len(demands[name].levels) - 1]
        weights = math.fsum(demands[name].weight for name in limited)
        for name, stream in self._streams.items():
            if name in limited:
                part = max(0.0, spare) * demands[name].weight / weights if weights else 0.0
                stream.grant(self._limits(stream, stream.refine(grants[name].settings, part)))
            else:
                stream.grant(None if name in grants and grants[name].level is None else {})

    def forget(self):
        """The focus has changed: all is divided anew, without a wait."""
        self._allocator.forget()

    def _thin(self, part):
        for stream in self._relays:
            thinned = {name: max(part * stream.asked[name], min(least, stream.asked[name]))
                       for name, least in stream.LEAST.items()}
            stream.grant(thinned if part < 1 else {})

    def _demands(self, now):
        """{stream: Demand} of those that have something to send to somebody."""
        demands = {}
        for name, stream in self._streams.items():
            self._sources[name].read(stream.received, now)
            asked = stream.asked
            if not asked['enabled'] or not stream.heard:
                continue
            levels = stream.levels(self._rate(stream))
            if levels:
                demands[name] = Demand(levels, asked['weight'], asked['floor'] * KBIT)
        return demands

    def _limits(self, stream, settings):
        """Of a level's settings those that limit a stream."""
        return {name: value for name, value in settings.items()
                if name != 'rate' or value < NEARLY * self._rate(stream)}

    def _rate(self, stream):
        """As it is asked for, or its source's where that is slower [Hz]."""
        return min(stream.asked['rate'], self._sources[stream.name].per_second or stream.asked['rate'])
