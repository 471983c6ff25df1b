# SPDX-License-Identifier: BSD-3-Clause
"""What new subscribers of a map and of its updates get."""
import threading
from typing import Any, Dict, List

import numpy as np
import pytest
from nav_msgs.msg import MapMetaData, OccupancyGrid
from polling import WAIT, wait_for

from smokebot_udp.nodes import map_publisher
from smokebot_udp.nodes.map_publisher import MapPublisher


class Topic:
    """Stands in for rospy's Publisher: there is no master."""
    made: Dict[str, 'Topic'] = {}

    def __init__(self, topic: str, class_: Any, listener: Any, **_: Any) -> None:
        self.listener = listener
        self.published: List[Any] = []
        self.made[topic] = self

    def publish(self, message: Any) -> None:
        self.published.append(message)

    def unregister(self) -> None:
        self.listener = None


def grid(cells: Any) -> OccupancyGrid:
    message = OccupancyGrid(info=MapMetaData(width=4, height=3, resolution=0.1))
    message.data = np.asarray(cells, np.int8).ravel()
    message.info.origin.orientation.w = 1.0
    return message


def test_an_update_that_overtakes_the_map_is_sent_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(map_publisher.rospy, 'Publisher', Topic)
    monkeypatch.setattr(map_publisher.rospy, 'is_shutdown', lambda: False)
    monkeypatch.setattr(map_publisher, 'REFRESHES', (0.1, 0.2))
    publisher = MapPublisher('/map', OccupancyGrid)
    maps, updates = Topic.made['/map'], Topic.made['/map_updates']
    publisher.publish(grid(np.zeros((3, 4))))
    cells = np.zeros((3, 4))
    cells[2, 3] = 100
    new: List[Any] = []
    maps.listener.peer_subscribe('/map', None, new.append)
    publisher.publish(grid(cells))
    assert len(new) == 1 and not np.any(new[0].data)
    assert [(one.x, one.y, one.width, one.height) for one in updates.published] == [(3, 2, 1, 1)]
    wait_for(lambda: len(updates.published) == 3)
    for one in updates.published[1:]:
        assert (one.x, one.y, one.width, one.height) == (0, 0, 4, 3)
        assert np.array_equal(np.reshape(one.data, (3, 4)), cells)
    monkeypatch.setattr(map_publisher, 'REFRESHES', (10 * WAIT,))       # none before the end
    before = set(threading.enumerate())
    maps.listener.peer_subscribe('/map', None, new.append)
    timer, = set(threading.enumerate()) - before
    publisher.unregister()
    timer.join(WAIT)
    assert not timer.is_alive() and len(updates.published) == 3
