# SPDX-License-Identifier: BSD-3-Clause
"""The newest content of each source and name is kept, and they take turns."""
import functools
import math
from typing import Any, Dict, List, Optional, Tuple

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from hypothesis import given
from hypothesis import strategies as st
from std_msgs.msg import String

from smokebot_udp.streams.relay.contents import MAX_CONTENTS, Turns

NODELETS = 5


def text(message: Any) -> bytes:
    data: bytes = message.data.encode()
    return data


def put(turns: Turns, source: str, data: str) -> str:
    return turns.add(String(data), source)


def take(turns: Turns) -> Optional[bytes]:
    return turns.due(text, math.inf, 0.0)


def test_a_newer_message_replaces_the_older_one_and_sources_take_turns() -> None:
    turns = Turns(String)
    put(turns, 'a', 'a1')
    put(turns, 'b', 'b1')
    put(turns, 'a', 'a2')
    assert take(turns) == b'a2'
    put(turns, 'a', 'a3')
    assert [take(turns) for _ in range(3)] == [b'b1', b'a3', None]


def test_all_messages_together_keep_to_the_rate() -> None:
    turns, taken, now = Turns(String), [], 0.0
    while now < 10.0:
        for source in 'abc':
            put(turns, source, source * 100)
        data = turns.due(text, 1000.0, now)
        if data is not None:
            taken.append((now, data[:1]))
        now += 0.01
    assert [source for _, source in taken] == [b'a', b'b', b'c'] * (len(taken) // 3) + [b'a'] * (len(taken) % 3)
    assert len(taken) == pytest.approx(100, abs=10) and taken[0][0] == 0.0


@given(st.lists(st.one_of(st.none(), st.sampled_from('abc'))))
def test_each_source_is_late_by_one_message_of_the_others_at_most(steps: List[Optional[str]]) -> None:
    turns, count = Turns(String), 0
    waited: Dict[str, int] = {}
    for source in steps:
        if source is not None:
            count += 1
            put(turns, source, '%s%d' % (source, count))
            waited.setdefault(source, 0)
            continue
        taken = take(turns)
        assert (taken is None) == (not waited)
        if taken is not None:
            del waited[taken[:1].decode()]
            waited = {other: turns + 1 for other, turns in waited.items()}
            assert max(waited.values(), default=0) < 3


def test_sources_without_end_take_no_memory() -> None:
    turns = Turns(String)
    refused = sum(put(turns, str(number), str(number)) != '' for number in range(2 * MAX_CONTENTS))
    put(turns, '3', 'newer')
    taken = list(iter(functools.partial(take, turns), None))
    assert refused == MAX_CONTENTS
    assert taken == [b'newer' if number == 3 else b'%d' % number for number in range(MAX_CONTENTS)]


# diagnostics

def array(second: int, **levels: int) -> Any:
    message = DiagnosticArray(status=[DiagnosticStatus(name=name, level=level) for name, level in levels.items()])
    message.header.stamp.secs = second
    return message


def shown(message: Any) -> Tuple[int, Dict[str, int]]:
    return message.header.stamp.secs, {status.name: status.level for status in message.status}


def taken_from(turns: Turns) -> List[Tuple[int, Dict[str, int]]]:
    return [shown(message) for message in iter(turns.take, None)]


def test_the_arrays_of_five_nodelets_of_one_manager_all_come() -> None:
    turns = Turns(DiagnosticArray)
    came: Dict[str, int] = dict.fromkeys(('nodelet%d' % number for number in range(NODELETS)), 0)
    for second in range(20):
        for name in came:
            turns.add(array(second, **{name: 0, name + '_device': 1}), '/manager')
        for _ in range(2):      # two of five a second have room
            for name in shown(turns.take())[1]:
                if name in came:
                    came[name] += 1
    assert min(came.values()) >= 6 and sum(came.values()) == 40


def test_of_an_array_what_no_newer_one_has_stays_with_its_time() -> None:
    turns = Turns(DiagnosticArray)
    turns.add(array(1, base=0, arm=0), '/manager')
    turns.add(array(2, laser=0), '/manager')
    turns.add(array(3, arm=2), '/manager')
    assert taken_from(turns) == [(1, {'base': 0}), (3, {'arm': 2}), (2, {'laser': 0})]


def test_an_array_that_nothing_replaced_crosses_as_it_is() -> None:
    turns, message = Turns(DiagnosticArray), array(1, base=0, arm=0)
    turns.add(message, '/manager')
    assert turns.take() is message and turns.take() is None


def test_statuses_of_one_name_are_of_different_nodes_and_devices() -> None:
    turns = Turns(DiagnosticArray)
    for node, device, level in ('/a', 'left', 0), ('/a', 'right', 1), ('/b', 'left', 2):
        message = array(1, battery=level)
        message.status[0].hardware_id = device
        turns.add(message, node)
    assert [levels['battery'] for _, levels in taken_from(turns)] == [0, 1, 2]


@given(st.lists(st.tuples(st.sampled_from('ab'), st.sets(st.sampled_from('vwxyz'), min_size=1), st.booleans())))
def test_every_newest_status_comes_once_and_no_older_one(steps: List[Any]) -> None:
    turns, newest = Turns(DiagnosticArray), {}
    for second, (node, names, takes) in enumerate(steps):
        turns.add(array(second, **dict.fromkeys((node + name for name in names), 0)), node)
        newest.update({node + name: second for name in names})
        message = turns.take() if takes else None
        for name in () if message is None else shown(message)[1]:
            assert newest.pop(name) == shown(message)[0]
    for second, names in taken_from(turns):
        for name in names:
            assert newest.pop(name) == second
    assert not newest
