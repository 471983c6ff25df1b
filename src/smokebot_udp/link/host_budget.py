# SPDX-License-Identifier: BSD-3-Clause
"""How often each host may make the robot compute, so that one host cannot take the others' share."""
import collections

from ..budget import Budget

MAX_HOSTS = 256
"""Remembered; the one that asked longest ago is forgotten."""


class HostBudgets:
    """A token bucket for each host.

    :param burst: times at once
    :param period: and then once in this time [s]
    """

    def __init__(self, burst: int, period: float) -> None:
        self._burst, self._period = burst, period
        self._budgets: collections.OrderedDict[int, Budget] = collections.OrderedDict()   # {IPv4 address: budget}

    def __len__(self) -> int:
        return len(self._budgets)

    def take(self, host: int, now: float) -> bool:
        """Whether to do it now for this host [s]."""
        budget = self._budgets.pop(host, None) or Budget(self._burst, self._period)
        self._budgets[host] = budget
        if len(self._budgets) > MAX_HOSTS:
            self._budgets.popitem(last=False)
        return budget.take(now)
