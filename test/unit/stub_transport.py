# SPDX-License-Identifier: BSD-3-Clause
"""A transport whose topics the test makes."""
from typing import Any, Callable, List


class SilentTopic:
    """A publisher or subscriber to which nobody is connected."""

    def connections(self) -> List[Any]:
        return []

    def unregister(self) -> None:
        """It has nothing to end."""


class StubTransport:
    """A transport.Transport without another side.

    :param publisher: makes the publishers, as Transport.publisher
    :param subscriber: likewise
    """
    name, max_datagram_size, room, overhead, tos_mask = '/desk', 1472, 1472, 0, 0xff

    def __init__(self, publisher: Callable[..., Any] = lambda *_, **__: SilentTopic(),
                 subscriber: Callable[..., Any] = lambda *_, **__: SilentTopic()) -> None:
        self.publisher, self.subscriber, self.on_moved = publisher, subscriber, lambda: None

    def paths(self, now: float) -> Any:
        return {}

    def limit(self, room: int) -> None:
        self.room = room
