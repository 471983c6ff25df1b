# SPDX-License-Identifier: BSD-3-Clause
"""How often something may be done for others, whoever they are."""


class Budget:
    """What strangers may make a node do: a number of times at once, and then once a period (a token bucket).

    :param period: [s]
    """

    def __init__(self, burst: int, period: float) -> None:
        self._burst, self._period = burst, period
        self._left, self._at = float(burst), 0.0

    def take(self, now: float) -> bool:
        """Whether to do it now [s]."""
        self._left = min(self._burst, self._left + max(0.0, now - self._at) / self._period)
        self._at = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True
