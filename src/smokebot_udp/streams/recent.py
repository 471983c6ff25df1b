# SPDX-License-Identifier: BSD-3-Clause
"""State of each of the sources that share a stream, such as the echoes of one scanner: their frame_id tells them apart.

Names come from messages and from the network, so only some are kept.
"""
import collections
from typing import Callable, Generic, List, OrderedDict, TypeVar

Value = TypeVar('Value')

MAX_SOURCES = 8
"""The one that was asked for longest ago is forgotten first."""


class Recent(Generic[Value]):
    """The state of the sources heard last.

    :param make: f() -> that of a new one
    """

    def __init__(self, make: Callable[[], Value]) -> None:
        self._make = make
        self._of: OrderedDict[str, Value] = collections.OrderedDict()

    def of(self, name: str) -> Value:
        """That of a source."""
        if name not in self._of:
            if len(self._of) == MAX_SOURCES:
                self._of.popitem(last=False)
            self._of[name] = self._make()
        self._of.move_to_end(name)
        return self._of[name]

    def all(self) -> List[Value]:
        """That of all sources."""
        return list(self._of.values())
