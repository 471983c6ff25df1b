# SPDX-License-Identifier: BSD-3-Clause
"""A robot that sends layered images to operators who report what they hold, for tests: both real sides, no network."""
from typing import Any, Callable, Collection, Dict, List, Mapping, Optional, Tuple

from genpy import Time
from layered_operator import Operator
from layered_sender import DATAGRAM, NO_LOSS, encoder, image, settings

from smokebot_udp.streams.frame_end import FIRST_MARGIN
from smokebot_udp.streams.held import Holding, from_message, to_message
from smokebot_udp.streams.outlook import Outlook

Loss = Callable[[str, int], Collection[int]]
"""f(operator, number of datagrams): which of them arrive."""


def everything(_: str, count: int) -> Collection[int]:
    return range(count)


def nothing(_: str, count: int) -> Collection[int]:
    return ()


class PredictedLink:
    """Images at a fixed rate; reports arrive some images later.

    :param names: of the operators
    :param delay: of a report [images]; 0: it comes before the next image
    :param of: settings of the robot's side
    """

    def __init__(self, names: Collection[str] = ('/operator',), delay: int = 0, outlook: Outlook = NO_LOSS,
                 period: float = 0.1, **of: Any) -> None:
        self.now, self.period, self._delay = 0.0, period, delay
        self.settings = settings(of.pop('granted', None), **of)
        sessions = iter(range(1000, 2000))
        self.encoder = encoder(self.settings, outlook, clock=lambda: self.now, session=lambda: next(sessions))
        self.operators: Dict[str, Operator] = {}
        for name in names:
            self.join(name)
        self.encoder.see(operators=lambda part: list(self.operators))
        self._reports: List[Tuple[int, str, Any]] = []      # number of the image when it comes, operator, message
        self.reported: Dict[str, Holding] = {}
        """The last report of each operator that has come."""
        self.sent: List[Any] = []
        """Records of each image."""

    def join(self, name: str) -> None:
        """A new operator, or one that has forgotten all."""
        self.operators[name] = Operator()

    def send(self, pixels: Any, encoding: str = 'mono8', loss: Loss = everything,
             reports: Collection[str] = ()) -> Mapping[str, Any]:
        """Send an image, and deliver the reports that are due.

        :param reports: operators whose report of this image is lost
        :return: {operator: Assembled or None}
        """
        for report in [report for report in self._reports if report[0] <= len(self.sent)]:
            self._reports.remove(report)
            self.reported[report[1]] = from_message(report[2])
            self.encoder.held(report[1], self.reported[report[1]])
        self.now += self.period
        message = image(pixels, encoding)
        message.header.stamp = Time.from_sec(self.now)
        frame, = self.encoder.encode(message, self.settings, DATAGRAM)
        self.sent.append(frame.records.copy())
        return {name: self._show(name, loss(name, len(frame)), name in reports) for name in self.operators}

    def _show(self, name: str, arrived: Collection[int], unreported: bool) -> Optional[Any]:
        operator, records = self.operators[name], self.sent[-1]
        shown = operator(records[sorted(arrived)], self.now) if arrived else []
        shown += operator.poll(self.now + FIRST_MARGIN) + operator.poll(self.now + self.period)
        holding = operator.assembler.holding()
        if arrived and holding is not None and not unreported:
            self._reports.append((len(self.sent) + self._delay, name, to_message(holding, 'camera', DATAGRAM)))
        return shown[-1] if shown else None

    @property
    def predicted(self) -> List[bool]:
        """For each image, whether it has a reference."""
        return [bool(records['picture'][0] != records['reference'][0]) for records in self.sent]
