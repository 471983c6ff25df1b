# SPDX-License-Identifier: BSD-3-Clause
"""How loaded a computer is: an overloaded one looks like a link that is cut."""
from .status import OK, WARN, Kind, Status
from .windows import Samples

OVERLOAD = 2.0
"""Programs that want a processor, for each of them. With two each has half of the time, and images come at half of
their rate; some come nevertheless."""

WINDOW = 10.0
"""The load is the median over this time: a build's or a browser's start is none [s]."""


def load(text: str, processors: int) -> float:
    """Programs that run or want to, for each processor, this one aside.

    :param text: of /proc/loadavg, whose fourth field has programs that run or want to / all programs
    """
    return max(0, int(text.split()[3].split('/')[0]) - 1) / processors


class ComputerMonitor:
    """Follows the load of a computer."""

    def __init__(self) -> None:
        self._loads = Samples(WINDOW)

    def update(self, now_loaded: float, now: float) -> Status:
        """The status at a time [s].

        :param now_loaded: see `load`
        """
        self._loads.add(now_loaded, now)
        usual = self._loads.percentile(50, now)
        overloaded = usual is not None and usual >= OVERLOAD
        text = 'overloaded: %.1f programs for each processor; images come late, or not at all' % (usual or 0.0)
        return Status(Kind.COMPUTER, 'computer', WARN if overloaded else OK, text if overloaded else 'fine',
                      {'programs for each processor': usual})
