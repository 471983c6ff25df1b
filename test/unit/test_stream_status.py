# SPDX-License-Identifier: BSD-3-Clause
import itertools
from typing import Any, Callable, Dict, List, Optional

import pytest

from smokebot_udp.image_error import EIGHT_BITS, ImageError
from smokebot_udp.monitoring.stats import ConnectionStats, Shown, StreamStats
from smokebot_udp.monitoring.status import ERROR, OK, OPERATOR, ROBOT, WARN, Status
from smokebot_udp.monitoring.stream_status import StreamMonitor
from smokebot_udp.monitoring.thresholds import Thresholds


def at(second: int, values: Dict[str, Any]) -> Dict[str, Any]:
    """The values, those that are functions of time evaluated."""
    return {key: value(second) if callable(value) else value for key, value in values.items()}


def connection(**counts: Any) -> Callable[[int], List[ConnectionStats]]:
    """A function of time that returns one connection; counts may be functions of time, too."""
    return lambda second: [ConnectionStats(**{
        'peer': '/robot_sender', 'address': ('10.0.0.1', 4000), 'datagrams': 100 * second, 'bytes': 100000 * second,
        'dropped': {'late': 3}, 'kernel_drops': 0, **at(second, counts)})]


def follow(side: str, stats: Dict[str, Any], seconds: int = 10, offset: Optional[float] = 0.0) -> List[List[Status]]:
    """The statuses of a stream in each second, from stats that may be functions of time."""
    monitor = StreamMonitor(side, 'thermal', '/thermal', Thresholds(), 0.0)
    return [monitor.update(StreamStats(**{'messages_in': 0, **at(second, stats)}), float(second), offset)
            for second in range(seconds + 1)]


def watch(side: str, seconds: int = 10, offset: Optional[float] = 0.0, **stats: Any) -> List[Status]:
    """The last statuses of a stream."""
    return follow(side, stats, seconds, offset)[-1]


def tenfold(second: int) -> int:
    return 10 * second


def test_a_good_stream_is_fine_and_all_its_values_are_shown() -> None:
    stream, found = watch(
        OPERATOR, offset=-1.0, messages_in=tenfold, messages_out=tenfold, dropped={'late': 3},
        shown=[Shown(1.05, 0.9)] * 9 + [Shown(1.25, 1.0)],
        connections=connection(received=lambda s: 90 * s, lost=lambda s: 10 * s))
    assert (stream.name, stream.level, stream.message) == ('thermal', OK, 'fine')
    values = {key: value for key, value in stream.values.items() if isinstance(value, float)}
    assert values == pytest.approx({'rate in [Hz]': 10, 'rate out [Hz]': 10, 'loss [%]': 10, 'completeness [%]': 90,
                                    'age p50 [ms]': 50, 'age p99 [ms]': 250, 'bytes/s': 1e5})
    assert stream.values['datagrams'] == 1000 and stream.values['lost'] == 100
    assert stream.values['dropped, late'] == 3 and stream.values['kernel drops'] == 0
    assert (found.name, found.level) == ('thermal, /robot_sender', OK)
    assert found.values['address'] == '10.0.0.1:4000' and found.values['loss [%]'] == pytest.approx(10)


@pytest.mark.parametrize('side, sent, busy, slow', [
    (ROBOT, 6, 0.95, True), (ROBOT, 6, 0.8, False), (ROBOT, 10, 0.95, False),
    (OPERATOR, 6, 0.95, True), (OPERATOR, 6, 0.8, False)])
def test_a_processor_that_is_the_limit_is_named(side: str, sent: int, busy: float, slow: bool) -> None:
    """The source has 30 Hz, of which 10 are wanted."""
    stream = watch(side, messages_in=lambda s: 30 * s, messages_out=lambda s: sent * s, rate=10.0,
                   busy=lambda s: busy * s, connections=connection())[0]
    assert (stream.message == 'this computer manages no more than 6 Hz of it: lower its rate or its size') == slow
    assert stream.level == (WARN if slow else OK)


@pytest.mark.parametrize('lost, level', [(29, OK), (30, WARN), (69, WARN), (70, ERROR)])
def test_loss_is_judged(lost: int, level: int) -> None:
    stream, found = watch(OPERATOR, messages_out=tenfold, connections=connection(
        received=lambda s: (100 - lost) * s, lost=lambda s: lost * s))
    assert stream.level == found.level == level
    assert (level == OK) == ('lost' not in stream.message)


def test_a_problem_of_the_stream_itself_is_shown() -> None:
    good = {'messages_in': tenfold, 'messages_out': tenfold, 'connections': connection(received=tenfold, lost=0)}
    stream, _ = watch(OPERATOR, problem='filled by nearest', **good)
    assert (stream.level, stream.message) == (WARN, 'filled by nearest')
    stream, _ = watch(OPERATOR, problem=None, **good)
    assert stream.level == OK


def test_the_loss_of_a_few_messages_is_chance() -> None:
    for rate, level in ((3, OK), (6, ERROR)):
        stream, _ = watch(OPERATOR, messages_out=tenfold,
                          connections=connection(received=0, lost=lambda s, rate=rate: rate * s))
        assert stream.values['loss [%]'] == 100.0 and stream.level == level


def test_late_messages_were_not_lost() -> None:
    """`lost` falls when a message arrives late; that is not a counter that restarted."""
    lost = itertools.chain([0, 1000, 998, 998, 998], itertools.repeat(998))
    stream, _ = watch(OPERATOR, seconds=12, messages_out=tenfold, connections=connection(
        received=lambda s: 100 * s + (2 if s > 1 else 0), lost=lambda s: next(lost)))
    assert stream.values['loss [%]'] == 0.0 and stream.level == OK


@pytest.mark.parametrize('age, level', [(0.4, OK), (0.5, WARN), (2.0, ERROR)])
def test_age_is_judged_by_the_robot_s_clock(age: float, level: int) -> None:
    stream, _ = watch(OPERATOR, offset=100.0, messages_out=tenfold, shown=[Shown(age - 100.0, None)],
                      connections=connection())
    assert stream.level == level


def test_without_the_robot_s_clock_there_is_no_age() -> None:
    stream, _ = watch(OPERATOR, offset=None, messages_out=tenfold, shown=[Shown(99.0, 1.0)], connections=connection())
    assert stream.level == OK and stream.values['age p50 [ms]'] is None


def test_a_stream_that_is_not_steady_may_be_old_and_silent() -> None:
    stream, _ = watch(OPERATOR, messages_out=1, shown=[Shown(99.0, 1.0)], steady=False, connections=connection())
    assert stream.level == OK


def test_incomplete_images_are_a_warning() -> None:
    stream, _ = watch(OPERATOR, messages_out=tenfold, shown=[Shown(0.1, 0.3)], connections=connection())
    assert stream.level == WARN and stream.message == 'only 30 % complete'


@pytest.mark.parametrize('errors, text', [
    ([ImageError(2.55, EIGHT_BITS)] * 3 + [ImageError(0.0, EIGHT_BITS)] * 2, '40 dB'),
    ([ImageError(0.0, EIGHT_BITS)] * 3 + [ImageError(2.55, EIGHT_BITS)] * 2, 'exact'),
    ([ImageError(9.0), ImageError(4.0, None, 25.0, 'K'), ImageError(2.0, None, 25.0, 'K')], '+-0.16 K'),
    ([ImageError(9.0), None], None), ([None], None)])
def test_the_median_error_of_layered_images_is_shown(errors: List[Any], text: Optional[str]) -> None:
    """In the words of the newest one; where images cross interleaved now, none."""
    stream, _ = watch(OPERATOR, messages_out=tenfold, shown=[Shown(0.1, None, error) for error in errors],
                      connections=connection())
    assert stream.values['error'] == text and stream.level == OK


@pytest.mark.parametrize('error, message', [
    (ImageError(25.6, EIGHT_BITS), 'only 20 dB'), (ImageError(81.0, EIGHT_BITS), 'only 10 dB'),
    (ImageError(25.4, EIGHT_BITS), 'fine'), (ImageError(0.0, EIGHT_BITS), 'fine'), (ImageError(99.0), 'fine'),
    (ImageError(900.0), 'an error of +-900 counts'), (ImageError(900.0, None, 100.0, 'K'), 'an error of +-9 K'),
    (ImageError(0.9, None, 0.01, 'cm'), 'fine')])
def test_bad_layered_images_are_a_warning(error: ImageError, message: str) -> None:
    stream, _ = watch(OPERATOR, messages_out=tenfold, shown=[Shown(0.1, None, error)], connections=connection())
    assert (stream.level, stream.message) == (OK if message == 'fine' else WARN, message)


def test_connections_of_two_parts_of_a_stream_are_told_apart() -> None:
    """One peer may send both from one address."""
    def both(second: int) -> List[ConnectionStats]:
        first, = connection(received=tenfold, lost=0)(second)
        second_one, = connection(received=tenfold, lost=tenfold, name='thermal/layers', bytes=0)(second)
        return [first, second_one]
    stream, first, second = watch(OPERATOR, messages_out=tenfold, connections=both)
    assert (first.name, second.name) == ('thermal, /robot_sender', 'thermal/layers, /robot_sender')
    assert (first.values['loss [%]'], second.values['loss [%]']) == (0.0, 50.0)
    assert stream.values['loss [%]'] == pytest.approx(100 / 3) and stream.values['bytes/s'] == pytest.approx(1e5)


def test_drops_of_the_kernel_are_a_warning() -> None:
    stream, found = watch(OPERATOR, messages_out=tenfold, connections=connection(kernel_drops=lambda s: s))
    assert stream.level == found.level == WARN and 'kernel' in stream.message


def test_silence_and_a_missing_connection_are_errors_at_the_operator() -> None:
    stream, _ = watch(OPERATOR, messages_out=5, connections=connection())
    assert stream.level == ERROR and stream.message == 'nothing is shown for 10 s'
    stream, = watch(OPERATOR, messages_out=0, steady=False)
    assert stream.level == ERROR and stream.message == 'no connection to the robot'
    stream, = watch(OPERATOR, messages_out=0, problem='the robot: rate is -5')
    assert stream.level == ERROR and stream.message == 'the robot: rate is -5'
    stream, = watch(OPERATOR, messages_out=tenfold)  # over TCPROS
    assert stream.level == OK


def test_a_stream_that_the_robot_does_not_send_may_be_silent() -> None:
    stream, _ = watch(OPERATOR, enabled=False, rate=10.0, messages_out=5, connections=connection())
    assert stream.level == OK and stream.message == 'off'
    stream, _ = watch(OPERATOR, enabled=True, rate=0.2, messages_out=5, connections=connection())
    assert stream.level == OK


@pytest.mark.parametrize('stats, level, message', [
    ({'messages_out': tenfold}, OK, 'fine'),
    ({'messages_out': 5}, ERROR, 'nothing is sent for 10 s'),
    ({'messages_out': 5, 'enabled': False}, OK, 'off'),
    ({'messages_out': 5, 'steady': False}, OK, 'fine'),
    ({'messages_out': 5, 'rate': 0.2}, OK, 'fine'),
    ({'messages_in': 7, 'messages_out': 5}, ERROR, 'its source is silent for 10 s'),
    ({'messages_out': 5, 'connections': []}, WARN, 'no subscriber'),
    ({'messages_out': tenfold, 'connections': connection(failures=lambda s: {'EPERM': s})}, WARN,
     '5 datagrams not sent'),
])
def test_the_robot_s_side_is_judged(stats: Dict[str, Any], level: int, message: str) -> None:
    statuses = watch(ROBOT, **{'messages_in': tenfold, 'connections': connection(), **stats})
    assert (statuses[0].level, statuses[0].message) == (level, message)


def test_a_stream_that_was_off_gets_its_time_when_it_is_on_again() -> None:
    found = follow(ROBOT, {'messages_in': tenfold, 'messages_out': 5, 'enabled': lambda second: second >= 10,
                           'connections': connection()}, seconds=11)
    assert [statuses[0].level for statuses in found] == [OK] * 12


def test_a_connection_that_has_ended_is_forgotten() -> None:
    """When it is back it is a new one: the growth of its counters starts anew."""
    found = follow(ROBOT, {'messages_in': tenfold, 'messages_out': tenfold, 'connections': lambda second: (
        [] if second == 5 else connection(failures={'EPERM': second})(second))}, seconds=7)
    assert [len(statuses) for statuses in found] == [2, 2, 2, 2, 2, 1, 2, 2]
    assert [statuses[-1].message for statuses in found[4:]] == [
        '4 datagrams not sent', 'no subscriber', 'connected', '1 datagrams not sent']


def test_commands_need_no_operator_at_the_robot_but_a_robot_at_the_operator() -> None:
    back: Dict[str, Any] = {'messages_out': 0, 'steady': False, 'to_robot': True, 'activity': 'idle, timeouts: 2'}
    stream, = watch(ROBOT, **back)
    assert (stream.level, stream.message) == (OK, 'fine')
    assert (stream.values['direction'], stream.values['activity']) == ('to the robot', 'idle, timeouts: 2')
    assert watch(OPERATOR, **back)[0].message == 'no connection to the robot'
    assert watch(ROBOT, problem='emergency stop', **back)[0].level == WARN
