# SPDX-License-Identifier: BSD-3-Clause
"""Which images all operators hold that a stream is sent to, by their reports (msg/Held).

Images are predicted from these, or from what is on its way where that risks little (prediction.py). An operator that
was sent an image and does not report for TIMEOUT must not ruin the images of the others for longer. It is left out, but
until it reports again one image each REFRESH needs no reference, in case that only its reports get lost.
"""
import math
import threading
from dataclasses import dataclass
from typing import Collection, Dict, List, Optional

from ..held import Holding

TIMEOUT = 1.0
"""[s]"""

REFRESH = 1.0
"""[s]"""

NOTHING = Holding(0, ())


@dataclass
class _Holder:
    holding: Holding = NOTHING
    """As reported last."""
    asked: Optional[float] = None
    """When the first image was sent since the last report; None: none was [s]."""

    def is_silent(self, now: float) -> bool:
        """Whether it should have reported."""
        return self.asked is not None and now - self.asked > TIMEOUT


class HeldByAll:
    """The reports of the operators of one stream. `held` is called by any thread, the others by one.

    All times are by one steady clock [s].
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._operators: Dict[str, _Holder] = {}
        self._refreshed = -math.inf     # when an image without a reference was sent last

    def held(self, name: str, holding: Holding) -> None:
        """Take the report of an operator that the stream is sent to, in place of its last one."""
        with self._lock:
            self._operators[name] = _Holder(holding)

    def sent(self, names: Collection[str], predicted: bool, now: float) -> None:
        """An image leaves to these operators."""
        if not predicted:
            self._refreshed = now
        for operator in self._served(names):
            if operator.asked is None:
                operator.asked = now

    def layers(self, names: Collection[str], session: int, numbers: Collection[int], now: float) -> Dict[int, int]:
        """What may serve as a reference.

        :param names: of the operators that the next image is sent to
        :param numbers: of the images that the robot keeps
        :return: {number of an image: how many of its layers all of them hold}; empty: the next image needs none
        """
        served = self._served(names)
        reporting = [operator.holding for operator in served if not operator.is_silent(now)]
        if len(reporting) < len(served) and now - self._refreshed >= REFRESH:
            return {}
        if not reporting or any(holding.session != session for holding in reporting):
            return {}
        held = {number: min(holding.layers_of(number) for holding in reporting) for number in numbers}
        return {number: layers for number, layers in held.items() if layers}

    def _served(self, names: Collection[str]) -> List[_Holder]:
        """The operators of these names; others are forgotten."""
        with self._lock:
            self._operators = {name: self._operators.get(name) or _Holder() for name in names}
            return list(self._operators.values())
