# SPDX-License-Identifier: BSD-3-Clause
import dataclasses
import math

import pytest

from smokebot_udp.monitoring.clock_offset import ClockEstimate
from smokebot_udp.monitoring.link_status import clock_status, link_status
from smokebot_udp.monitoring.stats import LinkStats
from smokebot_udp.monitoring.status import ERROR, OK, OPERATOR, WARN, Status, Verdict
from smokebot_udp.monitoring.thresholds import Thresholds
from smokebot_udp.nodes.diagnostics import as_message
from smokebot_udp.streams.config import NAME
from smokebot_udp.units import MBIT


def test_thresholds_must_be_numbers() -> None:
    thresholds, problems = Thresholds().override({'warn_loss': 0.1, 'error_silence': 5, 'fill': 'nearest'})
    assert thresholds == Thresholds(warn_loss=0.1, error_silence=5.0) and not problems
    for wrong in ('0.1', True, -1, math.nan, None, [1]):
        thresholds, problems = Thresholds(warn_loss=0.2).override({'warn_loss': wrong})
        assert thresholds == Thresholds(warn_loss=0.2) and 'warn_loss' in problems[0] and '0.2' in problems[0]


def test_the_worst_level_is_the_verdict_s() -> None:
    verdict = Verdict()
    verdict.check(None, 1.0, 2.0, '%.0f', 1)
    verdict.check(0.9, 1.0, 2.0, '%.0f', 1)
    assert verdict.level == OK and not str(verdict)
    verdict.check(2.0, 1.0, 2.0, '%.0f cm', 100)
    verdict.check(1.0, 1.0, 2.0, '%.0f m', 1)
    assert verdict.level == ERROR and str(verdict) == '200 cm, 1 m'


def test_the_clock_s_status() -> None:
    status = clock_status(ClockEstimate(-0.0125, 0.003, 0.002), {'jumps': 1})
    assert status.level == OK and status.values == pytest.approx(
        {'side': OPERATOR, 'offset [ms]': -12.5, 'round_trip [ms]': 3.0, 'uncertainty [ms]': 2.0, 'jumps': 1})
    assert clock_status(None, {'jumps': 0}).level == WARN


def test_the_link_s_status() -> None:
    stats = LinkStats(True, 2 * MBIT, MBIT, 5 * MBIT, 3 * MBIT, 0.1, 0.02, operator='/op', silence=2.0,
                      refused_reports={'too many operators': 5, 'order': 1})
    status = link_status(stats)
    assert (status.name, status.level, status.message) == ('link control', OK, 'fine')
    assert not NAME.match(status.name)      # else diagnostics could have it twice: streams.yaml has a stream `link`
    assert status.values == pytest.approx({
        'side': 'robot', 'state': 'as /op reports', 'rate [Mbit/s]': 2, 'sent [Mbit/s]': 1, 'wanted [Mbit/s]': 5,
        'capacity [Mbit/s]': 3, 'loss [%]': 10, 'queue delay [ms]': 20, 'round trip [ms]': math.nan,
        'reports refused, order': 1, 'reports refused, too many operators': 5}, nan_ok=True)
    status = link_status(dataclasses.replace(stats, timeout=True))
    assert (status.level, status.message) == (WARN, 'no reports of /op for 2.0 s')
    holed = link_status(dataclasses.replace(stats, timeout=True, longest=1172))
    assert (holed.level, holed.message) == (
        WARN, 'no reports of /op for 2.0 s, datagrams above 1172 bytes do not pass')
    assert holed.values['longest datagram [byte]'] == 1172
    fixed = link_status(dataclasses.replace(stats, adaptive=False, rate=None, timeout=True))
    assert (fixed.level, fixed.message) == (OK, 'fine')
    assert fixed.values['state'] == 'fixed' and fixed.values['rate [Mbit/s]'] == 0
    assert link_status(dataclasses.replace(stats, operator=None)).values['state'] == 'no operator has reported yet'


def test_a_message_has_no_unknown_values() -> None:
    message = as_message(Status('a', WARN, 'b', {'x': None, 'y': 1.23456789, 'z': 1234567}))
    assert [(pair.key, pair.value) for pair in message.values] == [('y', '1.23457'), ('z', '1234567')]
    assert (message.name, message.level, message.message) == ('a', WARN, 'b')
