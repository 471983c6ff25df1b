# SPDX-License-Identifier: BSD-3-Clause
"""What the log says of a black box that cannot record."""
from types import SimpleNamespace
from typing import Any, List

import pytest
import rospy

from smokebot_udp.limited_log import ERROR_PERIOD
from smokebot_udp.monitoring.computer import load
from smokebot_udp.nodes import black_box
from smokebot_udp.streams.recorded_topics import RecordedStream

ERROR = 'the black box does not record: %s. It goes on when that has changed'


class _Over(Exception):
    """The last problem was seen."""


@pytest.fixture
def lines(monkeypatch: Any) -> List[str]:
    made: List[str] = []
    for level in 'logerr', 'loginfo':
        monkeypatch.setattr(rospy, level, lambda text, *values: made.append(text % values))
    monkeypatch.setattr(rospy, 'is_shutdown', lambda: False)
    monkeypatch.setattr(rospy, 'get_node_uri', lambda: 'http://localhost:1/')
    monkeypatch.setattr(black_box, 'MasterWatch', lambda *_: SimpleNamespace(is_new=lambda: False))
    monkeypatch.setattr(black_box, 'Launch', lambda *_: SimpleNamespace(keep=lambda now: None))
    monkeypatch.setattr(black_box, 'end_all', lambda *_: None)
    return made


def run(problems: List[str], period: float, monkeypatch: Any) -> None:
    """A black box looks for problems.

    :param problems: what it finds, one after the other; empty: nothing
    :param period: between its looks [s]
    """
    now, left = [100.0], list(problems)

    def sleep(_: float) -> None:
        now[0] += period
        if not left:
            raise _Over
    monkeypatch.setattr(black_box, 'time', SimpleNamespace(sleep=sleep, monotonic=lambda: now[0]))
    monkeypatch.setattr('smokebot_udp.limited_log.time.monotonic', lambda: now[0])
    store: Any = SimpleNamespace(prune=list, problem=lambda: left.pop(0))
    with pytest.raises(_Over):
        black_box.BlackBox(store, []).run()


def test_the_streams_that_are_recorded_are_chosen_by_name() -> None:
    streams = {name: RecordedStream('image', False, ['/' + name]) for name in ('front', 'rear', 'odom')}
    assert black_box.chosen(streams, '') == (streams, [])
    assert black_box.chosen(streams, ' odom, front,') == ({name: streams[name] for name in ('front', 'odom')}, [])
    assert black_box.chosen(streams, 'rear,arm') == ({'rear': streams['rear']}, ['arm'])


def test_the_load_is_the_programs_that_want_a_processor() -> None:
    assert load('0.20 0.18 0.12 9/1200 4711', 4) == 2.0 and load('0.00 0.00 0.00 0/80 1', 4) == 0.0


def test_what_lasts_is_said_once_and_its_end(lines: List[str], monkeypatch: Any) -> None:
    run(['', '3 MB are free', '2 MB are free', '2 MB are free', '', ''], 60.0, monkeypatch)
    assert lines == [ERROR % '3 MB are free', 'the black box records again']


def test_a_disk_that_is_full_now_and_then_fills_no_log(lines: List[str], monkeypatch: Any) -> None:
    run(['%d MB are free' % step if step % 2 else '' for step in range(100)], 0.5, monkeypatch)
    assert len(lines) <= 2 * (1 + 50 / ERROR_PERIOD)
    assert lines[:2] == [ERROR % '1 MB are free', 'the black box records again']


def test_what_begins_again_soon_and_lasts_is_told(lines: List[str], monkeypatch: Any) -> None:
    run(['full', '', *['full'] * 20], 0.5, monkeypatch)
    assert lines == [ERROR % 'full', 'the black box records again', ERROR % 'full' + ' (and 8 more like it)']
