# SPDX-License-Identifier: BSD-3-Clause
"""What a part of a node opens ends with it."""
from typing import Any, Callable, List

import pytest

from smokebot_udp.nodes import opened as module
from smokebot_udp.nodes.opened import Opened, Part, open_until_end


class Recorded:
    """A topic, a worker or a part."""

    def __init__(self, name: str, events: List[str]) -> None:
        self._name, self._events = name, events

    def start(self) -> None:
        self._events.append('start ' + self._name)

    def close(self) -> None:
        self._events.append('close ' + self._name)
        if self._name == 'broken':
            raise RuntimeError('a fault of the test')

    unregister = close


def test_the_last_one_ends_first_and_once() -> None:
    events: List[str] = []
    opened = Opened()
    topic, worker, part = (Recorded(name, events) for name in ('topic', 'worker', 'part'))
    assert (opened.topic(topic), opened.started(worker), opened.add(part)) == (topic, worker, part)
    assert events == ['start worker']
    for _ in range(2):
        opened.close()
        assert events == ['start worker', 'close part', 'close worker', 'close topic']


def test_a_fault_keeps_nothing_open() -> None:
    events: List[str] = []

    class Node(Part):
        def __init__(self) -> None:
            super().__init__()
            for name in ('first', 'broken', 'last'):
                self._opened.add(Recorded(name, events))
    with pytest.raises(RuntimeError, match='a fault of the test'):
        Node().close()
    assert events == ['close last', 'close broken', 'close first']


def test_what_a_node_opens_ends_with_it_or_where_its_start_fails(monkeypatch: Any) -> None:
    events: List[str] = []
    ends: List[Callable[[], None]] = []
    monkeypatch.setattr(module.udpros, 'on_end', ends.append)
    with open_until_end() as opened:
        opened.add(Recorded('first', events))
        opened.add(Recorded('last', events))
    assert events == []
    ends[0]()
    assert events == ['close last', 'close first']
    with pytest.raises(KeyError), open_until_end() as opened:
        opened.add(Recorded('other', events))
        raise KeyError('a fault of the test')
    assert events[2:] == ['close other'] and len(ends) == 1
