# SPDX-License-Identifier: BSD-3-Clause
"""The newest lines of the logs of both sides."""
import collections
import itertools
from typing import Any, Deque, Dict, List, Mapping, Tuple

from ..monitoring.status import printable
from ..streams.relay.parameters import LEVEL_VALUES

MAX_ENTRIES, MAX_TEXT = 100, 500
"""Lines that are kept, and letters of one."""

LEVELS: Mapping[int, str] = {value: level for level, value in LEVEL_VALUES.items()}


class LogEntries:
    """One thread or several add, one reads."""

    def __init__(self) -> None:
        self._count = itertools.count(1)
        self._entries: Deque[Tuple[int, Dict[str, Any]]] = collections.deque(maxlen=MAX_ENTRIES)

    def add(self, message: Any, side: str) -> None:
        """Add a rosgraph_msgs/Log; one that both sides' logs have is added once."""
        entry = {'stamp': message.header.stamp.to_sec(), 'level': LEVELS.get(message.level, 'info'),
                 'node': printable(message.name[:MAX_TEXT]), 'text': printable(message.msg[:MAX_TEXT])}
        if not any(all(other[key] == entry[key] for key in entry) for _, other in list(self._entries)):
            self._entries.append((next(self._count), {**entry, 'side': side}))

    def after(self, number: int) -> Tuple[int, List[Dict[str, Any]]]:
        """The lines after one, oldest first, and the number of the last one."""
        found = [(count, entry) for count, entry in list(self._entries) if count > number]
        return (found[-1][0] if found else number), [entry for _, entry in found]
