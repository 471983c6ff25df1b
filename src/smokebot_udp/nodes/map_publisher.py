# SPDX-License-Identifier: BSD-3-Clause
"""Publishes a map as a whole where its place changes, and its changes as map_msgs/OccupancyGridUpdate.

rviz, costmaps and others read both topics. A new subscriber of the map gets the whole map as it is then, as if the
topic were latched. A new subscriber of the updates gets the whole map, too, as an update: it may have got the map
before, and missed updates since. A map and the updates after it come by two connections: on a busy machine an update
may come before the map, which does not have it, and be lost. So all get the whole map as an update REFRESHES after
somebody is new.
"""
import threading
from typing import Any, Callable, List, Optional

import rospy

from ..codecs.tiles.rectangle import Rectangle
from ..streams.grid.map_updates import UPDATE, cells_of, changed_rectangles, same_place, update_of
from ..streams.routes import UPDATES

REFRESHES = 2.0, 10.0
"""[s]"""

QUEUE = 256
"""Updates that wait for one subscriber: one that is lost would be missing for long."""


class MapPublisher:
    """Stands in for the rospy.Publisher of a map.

    :param topic: resolved topic of the map; that of the updates has _updates appended
    :param message_class: of the map, with arrays of numpy
    """

    def __init__(self, topic: str, message_class: Any) -> None:
        # of all that is published on both topics: rospy does not lock what it sends to one subscriber
        self._lock = threading.Lock()
        self._map: Optional[Any] = None
        self._timers: List[threading.Timer] = []
        self._updates = rospy.Publisher(topic + UPDATES, UPDATE, _Newcomers(self._greet_updates), queue_size=QUEUE,
                                        tcp_nodelay=True)
        self._maps = rospy.Publisher(topic, message_class, _Newcomers(self._greet_map), queue_size=2, tcp_nodelay=True)

    def publish(self, grid: Any) -> None:
        """Publish a map, as a whole or what has changed of it."""
        with self._lock:
            before, self._map = self._map, grid
            if before is None or not same_place(before, grid):
                self._maps.publish(grid)
                return
            for part in changed_rectangles(cells_of(before), cells_of(grid)):
                self._updates.publish(update_of(grid, part))

    def unregister(self) -> None:
        """End both topics."""
        self._cancel()
        self._maps.unregister()
        self._updates.unregister()

    def _cancel(self) -> None:
        for timer in self._timers:
            timer.cancel()

    def _refresh_later(self) -> None:
        """Another newcomer begins the time anew."""
        self._cancel()
        self._timers = [threading.Timer(delay, self._greet_updates, [self._updates.publish]) for delay in REFRESHES]
        for timer in self._timers:
            timer.daemon = True
            timer.start()

    def _greet_map(self, publish: Callable[[Any], None]) -> None:
        with self._lock:
            if self._map is not None:
                publish(self._map)
                self._refresh_later()

    def _greet_updates(self, publish: Callable[[Any], None]) -> None:
        with self._lock:
            if self._map is not None and not rospy.is_shutdown():
                publish(update_of(self._map, Rectangle(0, 0, self._map.info.width, self._map.info.height)))


class _Newcomers(rospy.SubscribeListener):
    """:param greet: f(publish), called with what publishes to a new subscriber alone"""

    def __init__(self, greet: Callable[[Callable[[Any], None]], None]) -> None:
        super().__init__()
        self._greet = greet

    def peer_subscribe(self, topic_name: str, topic_publish: Any, peer_publish: Callable[[Any], None]) -> None:
        self._greet(peer_publish)
