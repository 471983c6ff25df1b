# SPDX-License-Identifier: BSD-3-Clause
"""Calls in the background: nobody waits for them."""
import threading
from types import SimpleNamespace
from typing import Any, List

import pytest
from polling import WAIT, wait_for

from smokebot_udp.monitoring.source_types import SourceTypes
from smokebot_udp.nodes import diagnostics
from smokebot_udp.nodes.background_call import BackgroundCall


def test_the_answer_comes_later_and_once() -> None:
    go, calls = threading.Event(), []   # type: threading.Event, List[int]

    def slow() -> int:
        calls.append(1)
        assert go.wait(WAIT)
        return len(calls)
    call = BackgroundCall(slow)
    assert [call() for _ in range(3)] == [None] * 3 and calls == [1]
    go.set()
    assert wait_for(call) == 1
    assert wait_for(call) == 2


def test_what_fails_is_raised_once_and_tried_again() -> None:
    def fail() -> None:
        raise OSError('no answer')
    call = BackgroundCall(fail)
    for _ in range(2):
        with pytest.raises(OSError, match='no answer'):
            wait_for(call)


@pytest.mark.parametrize('side', [diagnostics.robot_diagnostics, diagnostics.operator_diagnostics])
def test_diagnostics_do_not_wait_for_the_master(monkeypatch: pytest.MonkeyPatch, side: Any) -> None:
    """A link that is cut answers after seconds, if at all."""
    never = threading.Event()
    monkeypatch.setattr(diagnostics, '_topic_types', lambda: never.wait(WAIT))
    made: List[Any] = []
    monkeypatch.setattr(diagnostics, 'SourceTypes', lambda ask: made.append(SourceTypes(ask)) or made[-1])
    monkeypatch.setattr(diagnostics, 'Diagnostics', lambda sources: sources)
    none: Any = SimpleNamespace(streams={}, values={}, report=None)
    side({}, *[none] * (5 if side is diagnostics.robot_diagnostics else 7))
    assert [made[0].problem('/fix', 'sensor_msgs/NavSatFix', float(second)) for second in range(10)] == [None] * 10
    never.set()
