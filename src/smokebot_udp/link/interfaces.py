# SPDX-License-Identifier: BSD-3-Clause
"""The interfaces by which the robot is asked, where the desk names them: they come and go while it runs."""
import math
import socket
from typing import Callable, List, Sequence

PERIOD = 1.0
"""How often the kernel is asked which there are [s]."""


def is_present(name: str) -> bool:
    """Whether this machine has an interface of this name now."""
    try:
        return socket.if_nametoindex(name) > 0
    except (OSError, ValueError):   # ValueError: a null character in it
        return False


class Interfaces:
    """The indices of named interfaces.

    :param names: empty: the kernel's routes decide
    :param report: f(text), called once each time that one is not there
    """

    def __init__(self, names: Sequence[str], report: Callable[[str], None]) -> None:
        self._names, self._report = names, report
        self._due = -math.inf
        self._present: Sequence[str] = names
        self.indices: Sequence[int] = (0,)
        """Those that are there, in the order of the names; (0,): the kernel's routes decide."""

    @property
    def problem(self) -> str:
        """What is wrong, in one sentence; empty: nothing."""
        return '' if self.indices else 'this machine has no interface %s now' % ' or '.join(self._names)

    def poll(self, now: float) -> None:
        """Look which there are, if that is due [s]."""
        if not self._names or now < self._due:
            return
        self._due = now + PERIOD
        present: List[str] = [name for name in self._names if is_present(name)]
        for name in self._present:
            if name not in present:
                self._report("interfaces: this machine has no interface '%s' now" % name)
        self._present, self.indices = present, [socket.if_nametoindex(name) for name in present]
