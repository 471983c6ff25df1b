# SPDX-License-Identifier: BSD-3-Clause
import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.monitoring.windows import ERROR, OK, WARN, Limits, Rate, Rates, Samples, Silence, Verdict, share
from smokebot_udp.nodes import diagnostics
from smokebot_udp.nodes.clock_sync import Estimate
from smokebot_udp.nodes.diagnostics import OPERATOR, ROBOT, StreamWatch


def test_a_rate_is_growth_over_time():
    rate = Rate(window=5.0)
    assert rate.per_second is None and rate.growth == 0
    rate.read(1000, 0.0)
    assert rate.per_second is None and rate.growth == 0
    for second in range(1, 20):
        rate.read(1000 + 10 * second, float(second))
        assert rate.per_second == pytest.approx(10.0)
    assert rate.growth == 50


def test_a_rate_forgets_what_is_older_than_its_window():
    rate = Rate(window=5.0)
    for second in range(30):
        rate.read(100 * min(second, 10), float(second))
    assert rate.per_second == 0.0 and rate.growth == 0


def test_a_counter_that_falls_began_anew():
    rate = Rate()
    for now, total in enumerate((100, 110, 4, 14)):
        rate.read(total, float(now))
    assert rate.growth == 10 + 4 + 10


def test_a_counter_that_cannot_be_read_is_passed_over():
    rate = Rate()
    for now, total in enumerate((None, 5, None, 15)):
        rate.read(total, float(now))
    assert rate.growth == 10 and rate.per_second == pytest.approx(5.0)


def test_readings_at_one_time_are_one():
    rate = Rate()
    for total, now in ((0, 1.0), (5, 1.0), (7, 0.5), (17, 2.0)):
        rate.read(total, now)
    assert rate.per_second == pytest.approx(10.0)


def test_a_rate_between_rare_readings():
    rate = Rate(window=1.0)
    rate.read(0, 0.0)
    rate.read(50, 10.0)
    assert rate.per_second == pytest.approx(5.0)
    rate.read(60, 20.0)
    assert rate.per_second == pytest.approx(1.0)


@given(st.lists(st.tuples(st.floats(0.0, 2.0), st.integers(0, 1000)), max_size=300))
def test_memory_is_bounded_and_rates_are_never_negative(steps):
    rate, now = Rate(most=16), 0.0
    for step, total in steps:
        now += step
        rate.read(total, now)
        assert len(rate._points) <= 16 and rate.growth >= 0 and (rate.per_second or 0) >= 0


def test_rates_by_name():
    rates = Rates('a', 'b')
    rates.read({'a': 1, 'c': 1}, 0.0)
    rates.read({'a': 3, 'c': 9}, 1.0)
    assert rates.per_second('a') == 2.0 and rates.growth('a') == 2
    assert rates.per_second('b') is None and rates.growth('b') == 0


def test_share():
    assert share(0, 0) is None and share(1, 4) == 0.25 and share(0, 4) == 0.0


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=100), st.integers(0, 100))
def test_percentiles_are_numpys(values, percent):
    samples = Samples(most=100)
    for value in values:
        samples.add(value, 0.0)
    found = samples.percentile(percent, 0.0)
    rank = max(0, math.ceil(len(values) * percent / 100) - 1)
    assert found == np.sort(values)[rank]


def test_samples_outside_the_window_do_not_count():
    samples = Samples(window=5.0)
    assert samples.percentile(50, 0.0) is None
    samples.add(1.0, 0.0)
    samples.add(3.0, 4.0)
    assert samples.percentile(50, 4.0) == 1.0
    assert samples.percentile(50, 6.0) == 3.0
    assert samples.percentile(50, 10.0) is None


def test_samples_that_are_no_numbers_are_none():
    samples = Samples(most=8)
    for value in (None, math.nan, math.inf):
        samples.add(value, 0.0)
    assert samples.percentile(99, 0.0) is None
    for value in range(100):
        samples.add(float(value), 0.0)
    assert samples.percentile(0, 0.0) == 92.0


def test_silence_is_too_long_from_the_limit_on():
    silence = Silence(0.0)
    assert silence.too_long(1.9, 2.0) is None and silence.too_long(2.1, 2.0) == pytest.approx(2.1)
    silence.read(0, 3.0)
    assert silence.too_long(3.0, 2.0) == pytest.approx(3.0)     # it counts, but has counted nothing
    silence.read(1, 4.0)
    assert silence.too_long(7.9, 4.0) is None and silence.too_long(8.1, 4.0) == pytest.approx(4.1)
    silence.forgive(9.0)
    assert silence.too_long(12.9, 4.0) is None


def test_what_fell_silent_soon_is_silent_too_long_all_the_same():
    silence = Silence(0.0)
    for second in range(20):
        silence.read(min(3, second), float(second))
    assert silence.too_long(5.9, 2.0) is None and silence.too_long(6.1, 2.0) == pytest.approx(3.1)
    assert silence.too_long(19.0, 2.0) == 16.0


def test_what_speaks_rarely_may_be_silent_for_longer():
    silence = Silence(0.0)
    for second in range(41):
        silence.read(second // 4, float(second))
    assert silence.too_long(51.0, 2.0) is None      # 11 s where 4 s are usual
    assert silence.too_long(53.5, 2.0) == pytest.approx(13.5)


def test_limits_are_taken_where_they_are_numbers():
    limits, problems = Limits().changed({'warn_loss': 0.1, 'error_silence': 5, 'fill': 'nearest'})
    assert limits == Limits(warn_loss=0.1, error_silence=5.0) and not problems
    for wrong in ('0.1', True, -1, math.nan, None, [1]):
        limits, problems = Limits(warn_loss=0.2).changed({'warn_loss': wrong})
        assert limits == Limits(warn_loss=0.2) and 'warn_loss' in problems[0] and '0.2' in problems[0]


def test_the_worst_is_the_verdict():
    verdict = Verdict()
    verdict.at_least(None, 1.0, 2.0, '%.0f', 1)
    verdict.at_least(0.9, 1.0, 2.0, '%.0f', 1)
    assert verdict.level == OK and not str(verdict)
    verdict.at_least(2.0, 1.0, 2.0, '%.0f cm', 100)
    verdict.at_least(1.0, 1.0, 2.0, '%.0f m', 1)
    assert verdict.level == ERROR and str(verdict) == '200 cm, 1 m'


class Stream:
    """Tells what it is made to tell."""
    name, topic = 'thermal', '/thermal'

    def __init__(self, **figures):
        self.now = figures

    def figures(self):
        return {key: value(self.second) if callable(value) else value for key, value in self.now.items()}


def connection(**counts):
    return lambda second: [{'peer': '/robot_sender', 'address': ('10.0.0.1', 4000), 'datagrams': 100 * second,
                            'bytes': 100000 * second, 'dropped': {'late': 3}, 'kernel_drops': 0,
                            **{key: value(second) if callable(value) else value for key, value in counts.items()}}]


def watch(side, seconds=10, offset=0.0, told=None, **figures):
    """The last statuses of a stream that is looked at each second."""
    stream = Stream(**figures)
    watched = StreamWatch(side, stream, Limits(), 0.0)
    for stream.second in range(seconds + 1):
        statuses = watched.look(float(stream.second), offset, told)
    return statuses


def tenfold(second):
    return 10 * second


def test_a_good_stream_is_fine_and_tells_all():
    stream, found = watch(
        OPERATOR, offset=-1.0, **{'in': tenfold}, out=tenfold, shown=[(1.05, 0.9)] * 9 + [(1.25, 1.0)],
        dropped={'late': 3}, connections=connection(received=lambda s: 90 * s, lost=lambda s: 10 * s))
    assert (stream.name, stream.level, stream.message) == ('thermal', OK, 'fine')
    told = {key: value for key, value in stream.values.items() if isinstance(value, float)}
    assert told == pytest.approx({'rate in [Hz]': 10, 'rate out [Hz]': 10, 'loss [%]': 10, 'completeness [%]': 90,
                                  'age p50 [ms]': 50, 'age p99 [ms]': 250, 'bytes/s': 1e5})
    assert stream.values['datagrams'] == 1000 and stream.values['lost'] == 100
    assert stream.values['dropped, late'] == 3 and stream.values['kernel drops'] == 0
    assert (found.name, found.level) == ('thermal, /robot_sender', OK)
    assert found.values['address'] == '10.0.0.1:4000' and found.values['loss [%]'] == pytest.approx(10)


@pytest.mark.parametrize('lost, level', [(29, OK), (30, WARN), (69, WARN), (70, ERROR)])
def test_loss_is_judged(lost, level):
    stream, found = watch(OPERATOR, out=tenfold, connections=connection(
        received=lambda s: (100 - lost) * s, lost=lambda s: lost * s))
    assert stream.level == found.level == level
    assert (level == OK) == ('lost' not in stream.message)


def test_what_a_stream_says_of_itself_is_told():
    good = {'in': tenfold, 'out': tenfold, 'connections': connection(received=tenfold, lost=0)}
    stream, _ = watch(OPERATOR, problem='filled by nearest', **good)
    assert (stream.level, stream.message) == (WARN, 'filled by nearest')
    stream, _ = watch(OPERATOR, problem=None, **good)
    assert stream.level == OK


def test_loss_of_a_few_messages_is_chance():
    for rate, level in ((3, OK), (6, ERROR)):
        stream, _ = watch(OPERATOR, out=tenfold, connections=connection(received=0, lost=lambda s, rate=rate: rate * s))
        assert stream.values['loss [%]'] == 100.0 and stream.level == level


def test_what_comes_late_was_not_lost():
    """lost falls where it was counted before; that is no counter that began anew."""
    lost = itertools.chain([0, 1000, 998, 998, 998], itertools.repeat(998))
    stream, _ = watch(OPERATOR, seconds=12, out=tenfold, connections=connection(
        received=lambda s: 100 * s + (2 if s > 1 else 0), lost=lambda s: next(lost)))
    assert stream.values['loss [%]'] == 0.0 and stream.level == OK


@pytest.mark.parametrize('age, level', [(0.4, OK), (0.5, WARN), (2.0, ERROR)])
def test_age_is_judged_by_the_robots_clock(age, level):
    stream, _ = watch(OPERATOR, offset=100.0, out=tenfold, shown=[(age - 100.0, None)], connections=connection())
    assert stream.level == level


def test_without_the_robots_clock_there_is_no_age():
    stream, _ = watch(OPERATOR, offset=None, out=tenfold, shown=[(99.0, 1.0)], connections=connection())
    assert stream.level == OK and stream.values['age p50 [ms]'] is None


def test_what_is_not_steady_may_be_old_and_silent():
    stream, _ = watch(OPERATOR, out=1, shown=[(99.0, 1.0)], steady=False, connections=connection())
    assert stream.level == OK


def test_incomplete_pictures_are_told():
    stream, _ = watch(OPERATOR, out=tenfold, shown=[(0.1, 0.3)], connections=connection())
    assert stream.level == WARN and stream.message == 'only 30 % complete'


def test_a_buffer_that_is_too_small_is_told():
    stream, found = watch(OPERATOR, out=tenfold, connections=connection(kernel_drops=lambda s: s))
    assert stream.level == found.level == WARN and 'kernel' in stream.message


def test_silence_and_no_connection_are_errors_at_the_operator():
    stream, _ = watch(OPERATOR, out=5, connections=connection())
    assert stream.level == ERROR and stream.message == 'nothing is shown for 10 s'
    stream, = watch(OPERATOR, out=0, steady=False)
    assert stream.level == ERROR and stream.message == 'no connection to the robot'
    stream, = watch(OPERATOR, out=tenfold)  # it comes by TCPROS
    assert stream.level == OK


def test_what_the_robot_does_not_send_may_be_silent():
    stream, _ = watch(OPERATOR, told={'enabled': False, 'rate': 10.0}, out=5, connections=connection())
    assert stream.level == OK and stream.message == 'off'
    stream, _ = watch(OPERATOR, told={'enabled': True, 'rate': 0.2}, out=5, connections=connection())
    assert stream.level == OK


@pytest.mark.parametrize('figures, level, message', [
    ({'out': tenfold}, OK, 'fine'),
    ({'out': 5}, ERROR, 'nothing is sent for 10 s'),
    ({'out': 5, 'enabled': False}, OK, 'off'),
    ({'out': 5, 'steady': False}, OK, 'fine'),
    ({'out': 5, 'rate': 0.2}, OK, 'fine'),
    ({'in': 7, 'out': 5}, ERROR, 'its source is silent for 10 s'),
    ({'out': 5, 'connections': []}, WARN, 'nobody takes it'),
    ({'out': tenfold, 'connections': connection(failures=lambda s: {'EPERM': s})}, WARN, '5 datagrams not sent'),
])
def test_the_robots_side_is_judged(figures, level, message):
    statuses = watch(ROBOT, **{'in': tenfold, 'connections': connection(), **figures})
    assert (statuses[0].level, statuses[0].message) == (level, message)


def test_what_was_off_gets_its_time_when_it_is_on_again():
    stream = Stream(**{'in': tenfold}, out=5, enabled=lambda second: second >= 10, connections=connection())
    watched = StreamWatch(ROBOT, stream, Limits(), 0.0)
    for stream.second in range(12):
        level = watched.look(float(stream.second))[0].level
        assert level == OK, stream.second


def test_a_connection_that_ends_is_forgotten():
    stream = Stream(out=tenfold, connections=lambda second: connection()(second) if second < 5 else [])
    watched = StreamWatch(ROBOT, stream, Limits(), 0.0)
    for stream.second in range(10):
        assert len(watched.look(float(stream.second))) == (2 if stream.second < 5 else 1)
    assert not watched._connections


def test_the_clock_is_told():
    status = diagnostics.clock_status(Estimate(-0.0125, 0.003, 0.002), {'jumps': 1})
    assert status.level == OK and status.values == pytest.approx(
        {'side': OPERATOR, 'offset [ms]': -12.5, 'round_trip [ms]': 3.0, 'uncertainty [ms]': 2.0, 'jumps': 1})
    assert diagnostics.clock_status(None, {'jumps': 0}).level == WARN


def test_a_message_has_no_value_that_is_not_known():
    message = diagnostics.as_message(diagnostics.Status('a', WARN, 'b', {'x': None, 'y': 1.23456789, 'z': 1234567}))
    assert [(pair.key, pair.value) for pair in message.values] == [('y', '1.23457'), ('z', '1234567')]
    assert (message.name, message.level, message.message) == ('a', WARN, 'b')
