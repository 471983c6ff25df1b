# SPDX-License-Identifier: BSD-3-Clause
"""A dictionary of bounded size: its keys may be names and numbers that come from the network."""
from typing import Callable, OrderedDict, TypeVar

Key = TypeVar('Key')
Value = TypeVar('Value')


class Newest(OrderedDict[Key, Value]):
    """Keeps the entries that were set last, in this order.

    :param most: of more entries the first one is forgotten
    """

    def __init__(self, most: int) -> None:
        super().__init__()
        self._most = most

    def __setitem__(self, key: Key, value: Value) -> None:
        super().__setitem__(key, value)
        self.move_to_end(key)
        if len(self) > self._most:
            self.popitem(last=False)

    def of(self, key: Key, make: Callable[[], Value]) -> Value:
        """The value of a key, `make()` where it has none; it counts as set now."""
        value = self[key] = self[key] if key in self else make()
        return value
