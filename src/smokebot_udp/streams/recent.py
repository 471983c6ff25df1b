# SPDX-License-Identifier: BSD-3-Clause
"""State of each of the sources that share a stream, such as the echoes of one scanner: their frame_id tells them apart.

Names come from messages and from the network, so only some are kept.
"""
from typing import Callable, Generic, List, TypeVar

from ..newest import Newest

Value = TypeVar('Value')

MAX_SOURCES = 8
"""The one that was asked for longest ago is forgotten first."""


class Recent(Generic[Value]):
    """The state of the sources heard last.

    :param make: f() -> that of a new one
    """

    def __init__(self, make: Callable[[], Value]) -> None:
        self._make = make
        self._of: Newest[str, Value] = Newest(MAX_SOURCES)

    def of(self, name: str) -> Value:
        """That of a source."""
        return self._of.of(name, self._make)

    def all(self) -> List[Value]:
        """That of all sources."""
        return list(self._of.values())
