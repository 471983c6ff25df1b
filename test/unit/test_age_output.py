# SPDX-License-Identifier: BSD-3-Clause
"""The topic of a map's ages."""
import queue
from typing import Any, List

import pytest
import rospy
from nav_msgs.msg import OccupancyGrid
from polling import WAIT

from smokebot_udp.nodes import age_output
from smokebot_udp.nodes.age_output import AgeOutput


class FakePublisher:
    """Stands in for rospy.Publisher."""
    made: List['FakePublisher'] = []

    def __init__(self, name: str, class_: Any, **options: Any) -> None:
        self.name, self.class_, self.options, self.closed = name, class_, options, False
        self.sent: queue.Queue[Any] = queue.Queue()
        self.made.append(self)

    def publish(self, message: Any) -> None:
        self.sent.put(message)

    def unregister(self) -> None:
        self.closed = True


@pytest.fixture
def publishers(monkeypatch: Any) -> List[FakePublisher]:
    monkeypatch.setattr(rospy, 'Publisher', FakePublisher)
    monkeypatch.setattr(rospy, 'is_shutdown', lambda: False)
    monkeypatch.setattr(FakePublisher, 'made', [])
    return FakePublisher.made


def test_ages_are_published_regularly_and_with_a_new_map(publishers: List[FakePublisher], monkeypatch: Any) -> None:
    monkeypatch.setattr(age_output, 'PERIOD', 0.05)
    found: List[Any] = [None, None, 1, 2, 3]
    output = AgeOutput('/operator/map', OccupancyGrid, lambda: found.pop(0) if found else None)
    publisher, = publishers
    assert (publisher.name, publisher.class_, publisher.options['latch']) == ('/operator/map/age', OccupancyGrid, True)
    assert [publisher.sent.get(timeout=WAIT) for _ in range(3)] == [1, 2, 3]
    output.close()
    assert publisher.closed

    monkeypatch.setattr(age_output, 'PERIOD', 3600.0)
    output = AgeOutput('map', OccupancyGrid, lambda: 'now')
    output.show('a map')
    assert publishers[1].sent.get(timeout=WAIT) == 'now'
    output.close()
