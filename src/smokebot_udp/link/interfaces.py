# SPDX-License-Identifier: BSD-3-Clause
"""The interfaces by which the robot is asked, where the desk names them: they come and go while it runs."""
import math
import socket
from typing import Callable, Dict, Iterable, Optional

PERIOD = 1.0
"""How often the kernel is asked which there are [s]."""


def index_of(name: str) -> Optional[int]:
    """The index of an interface of this machine; None: it has none of this name now."""
    try:
        return socket.if_nametoindex(name)
    except (OSError, ValueError):   # ValueError: a null character in it
        return None


class Interfaces:
    """The indices of named interfaces.

    :param names: empty ones are of no interface
    :param report: f(text), called once each time that one is not there
    """

    def __init__(self, names: Iterable[str], report: Callable[[str], None]) -> None:
        self._report, self._due = report, -math.inf
        self._found: Dict[str, Optional[int]] = {name: 0 for name in names}

    @property
    def problem(self) -> Optional[str]:
        """What is wrong, in one sentence; None: one of them is there."""
        if not self._found or any(index is not None for index in self._found.values()):
            return None
        return 'this machine has no interface %s now' % ' or '.join(self._found)

    def index(self, name: str) -> Optional[int]:
        """As found last; None: there is none. 0, by which the kernel's routes decide, for the empty name."""
        return self._found[name]

    def poll(self, now: float) -> None:
        """Look which there are, if that is due [s]."""
        if now < self._due:
            return
        self._due = now + PERIOD
        for name, before in self._found.items():
            self._found[name] = index_of(name) if name else 0
            if self._found[name] is None and before is not None:
                self._report("robot: this machine has no interface '%s' now" % name)
