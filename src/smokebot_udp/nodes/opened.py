# SPDX-License-Identifier: BSD-3-Clause
"""What a part of a node has opened, and closes in reverse order when it ends."""
import contextlib
from typing import Iterator, Protocol, TypeVar

from .. import udpros


class Closed(Protocol):
    """What ends by `close`."""

    def close(self) -> None:
        """End it."""


class Started(Closed, Protocol):
    """A thread."""

    def start(self) -> None:
        """Begin."""


class Unregistered(Protocol):
    """A topic of rospy, or of a transport."""

    def unregister(self) -> None:
        """End it."""


Some = TypeVar('Some', bound=Closed)
Worker = TypeVar('Worker', bound=Started)
Topic = TypeVar('Topic', bound=Unregistered)


class Opened(contextlib.ExitStack):
    """`close` ends all that was added, the last one first; also what comes after one that fails."""

    def add(self, part: Some) -> Some:
        """The part."""
        self.callback(part.close)
        return part

    def started(self, worker: Worker) -> Worker:
        """The worker, whose thread is started."""
        worker.start()
        return self.add(worker)

    def topic(self, topic: Topic) -> Topic:
        """The publisher or subscriber."""
        self.callback(topic.unregister)
        return topic


@contextlib.contextmanager
def open_until_end() -> Iterator[Opened]:
    """What a node opens in this context stays open until the node ends.

    It is closed at the end of the context where that fails, or where the node is ended while it starts.
    """
    with Opened() as opened:
        yield opened
        udpros.on_end(opened.pop_all().close)


class Part:
    """A part of a node, which adds what it opens to `_opened`."""

    def __init__(self) -> None:
        self._opened = Opened()

    def close(self) -> None:
        """End all that it has opened, the last one first."""
        self._opened.close()
