# SPDX-License-Identifier: BSD-3-Clause
"""Of each source the newest message."""
import functools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.reliable.newest import MAX_SOURCES, Newest


def test_a_newer_message_replaces_the_older_one_and_sources_take_turns() -> None:
    newest = Newest()
    newest.put('a', b'a1')
    newest.put('b', b'b1')
    newest.put('a', b'a2')
    assert newest.take(math.inf, 0.0) == b'a2'
    newest.put('a', b'a3')
    assert [newest.take(math.inf, 0.0) for _ in range(3)] == [b'b1', b'a3', None]


def test_all_messages_together_keep_to_the_rate() -> None:
    newest, taken, now = Newest(), [], 0.0
    while now < 10.0:
        for source in 'abc':
            newest.put(source, source.encode() * 100)
        data = newest.take(1000.0, now)
        if data is not None:
            taken.append((now, data[:1]))
        now += 0.01
    assert [source for _, source in taken] == [b'a', b'b', b'c'] * (len(taken) // 3) + [b'a'] * (len(taken) % 3)
    assert len(taken) == pytest.approx(100, abs=10) and taken[0][0] == 0.0


@given(st.lists(st.one_of(st.none(), st.sampled_from('abc'))))
def test_each_source_is_late_by_one_message_of_the_others_at_most(steps) -> None:
    newest, count, waited = Newest(), 0, {}
    for source in steps:
        if source is not None:
            count += 1
            newest.put(source, b'%s%d' % (source.encode(), count))
            waited.setdefault(source, 0)
            continue
        taken = newest.take(math.inf, 0.0)
        assert (taken is None) == (not waited)
        if taken is not None:
            del waited[taken[:1].decode()]
            waited = {other: turns + 1 for other, turns in waited.items()}
            assert max(waited.values(), default=0) < 3


def test_sources_without_end_take_no_memory() -> None:
    newest = Newest()
    for number in range(2 * MAX_SOURCES):
        newest.put(str(number), b'%d' % number)
    taken = list(iter(functools.partial(newest.take, math.inf, 0.0), None))
    assert taken == [b'%d' % number for number in range(MAX_SOURCES, 2 * MAX_SOURCES)]
