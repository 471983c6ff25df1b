# SPDX-License-Identifier: BSD-3-Clause
"""What was measured on the way back (way_back.py), against its goals. Pure.

A log is a list of [number, time [s]]: of commands or of messages, as they were sent or as they were heard. The number 0
is a command that stands still.
"""
import math
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from smokebot_udp.arrays import FloatArray

from .one_of import percentile

Log = Sequence[Tuple[int, float]]
Raw = Mapping[str, Any]
"""What way_back.py measured in a scene."""

MAX_AGE, TIMEOUT = 0.3, 0.5
"""Maximum age and timeout of the command stream [s]."""

STOP_WITHIN = TIMEOUT + 0.05
"""Goal of the time until the robot stops [s]."""

LISTENING = 0.02
"""Time from the robot's decision to the listener on its side [s]."""

PERIOD, HALF_ROUND_TRIP, SLACK = 0.05, 0.05, 0.02
WITHIN = PERIOD + HALF_ROUND_TRIP + SLACK
"""A command, or a newer one, is to be in force by then [s]."""

LAST = 10
"""Commands at the end that have no newer ones behind them do not count."""

ESTOP_WITHIN, ESTOP_SHARE = 0.25, 0.999
CALL_MEDIAN = 2 * HALF_ROUND_TRIP + 0.05
AIR_SLACK = 0.02
"""[s]"""


class Result(NamedTuple):
    """One line of the table."""
    scene: str
    what: str
    tried: int
    times: Tuple[float, ...]
    """Median, p99 and worst [s]; empty: it is no time."""
    found: str
    goal: str
    """Empty: it is only reported."""
    met: bool


def statistics(times: Any) -> Tuple[float, ...]:
    """Median, p99 and worst of (n,) times; of none: empty."""
    if not len(times):
        return ()
    return tuple(percentile(times, share) for share in (50, 99, 100))


def until_in_force(sent: Log, heard: Log) -> FloatArray:
    """How long it took until each command, or a newer one, was heard: (n,) [s]; inf: never."""
    newest = np.maximum.accumulate([0, *(number for number, _ in heard)])
    when = np.array([-math.inf, *(at for _, at in heard), math.inf])
    first = np.searchsorted(newest, [number for number, _ in sent])
    times: FloatArray = when[first] - np.array([at for _, at in sent])
    return times


def ages(sent: Log, heard: Log) -> FloatArray:
    """The ages of the numbers that were heard, in the order in which they were heard: (n,) [s]; inf: it was never
    sent."""
    made = dict(sent)
    times: FloatArray = np.array([at - made.get(number, -math.inf) for number, at in heard if number], np.float64)
    return times


def out_of_order(heard: Log) -> int:
    """Numbers heard after the same or a higher one."""
    numbers = [number for number, _ in heard if number]
    newest = np.maximum.accumulate([0, *numbers])
    return int(np.count_nonzero(np.array(numbers, np.int64) <= newest[:-1]))


def stop_after(cut: float, restored: float, heard: Log) -> float:
    """From a cut to the first command during it that stands still [s]; inf: there is none."""
    return next((at - cut for number, at in heard if not number and cut <= at <= restored), math.inf)


def first_after(restored: float, heard: Log) -> Optional[Tuple[int, float]]:
    """The first command heard after a time that does not stand still."""
    return next(((number, at) for number, at in heard if number and at >= restored), None)


def share_within(times: FloatArray, limit: float) -> float:
    """The share of times up to a limit; of none: 0."""
    return float(np.mean(times <= limit)) if len(times) else 0.0


def safety(raw: Raw) -> List[Result]:
    """No command out of order, and none that is too old."""
    heard, wrong = raw['heard'], out_of_order(raw['heard'])
    found = ages(raw['sent'], heard)
    old = int(np.count_nonzero(found > MAX_AGE + LISTENING))
    scene, none = raw['scene'], len(found) == 0
    return [Result(scene, 'age of a command that takes effect', len(found), statistics(found), '', '', True),
            Result(scene, 'out of order, or older than %g ms' % (1e3 * MAX_AGE), len(found), (),
                   '%d, %d' % (wrong, old), '0, 0', not (wrong or old or none))]


def judged(raw: Raw) -> Log:
    """The commands since a time, without the LAST."""
    return [one for one in raw['sent'][:-LAST] if one[1] >= raw['since']]


def commands(raw: Raw) -> List[Result]:
    """Commands at a steady rate over a bad link since a time.

    Goals, where there are any: `raw['share']` that is to be in force in time, `raw['age']` at p99 [s].
    """
    times = until_in_force(judged(raw), raw['heard'])
    share, least = share_within(times, WITHIN), raw.get('share', 0.0)
    age, order = safety(raw)
    if 'age' in raw:
        age = age._replace(goal='p99 ≤ %.0f ms' % (1e3 * raw['age']),
                           met=bool(age.times) and age.times[1] <= raw['age'])
    return [Result(raw['scene'], 'in force, it or a newer one, within %.0f ms' % (1e3 * WITHIN), len(times),
                   statistics(times), '%.2f %%' % (100 * share), at_least(least), share >= least), age, order]


def at_least(share: float) -> str:
    """A goal in words."""
    return '≥ %g %%' % (100 * share) if share else ''


def stops(raw: Raw) -> List[Result]:
    """`raw['events']`: [(when commands cannot arrive any more, when they can again)]"""
    heard, limit = raw['heard'], STOP_WITHIN
    times = np.array([stop_after(cut, restored, heard) for cut, restored in raw['events']])
    made = dict(raw['sent'])
    again = [first_after(restored, heard) for _, restored in raw['events']]
    fresh = [found[1] - made.get(found[0], -math.inf) for found in again if found]
    met = int(np.count_nonzero(times <= limit))
    return [Result(raw['scene'], 'stop, after commands cannot arrive', len(times), statistics(times),
                   '%d of %d within %.0f ms' % (met, len(times), 1e3 * limit), 'all', met == len(times) > 0),
            Result(raw['scene'], 'age of the first command afterwards', len(fresh), statistics(fresh), '', 'all come',
                   len(fresh) == len(times)),
            safety(raw)[1]]


def estops(raw: Raw) -> List[Result]:
    """`raw['tries']`: [(published, in force or null, release published, released or null)]"""
    tries = raw['tries']
    times = np.array([(math.inf if engaged is None else engaged) - published for published, engaged, _, _ in tries])
    released = [math.inf if done is None else done - asked for _, _, asked, done in tries]
    share = share_within(times, ESTOP_WITHIN)
    moved = sum(any(number and engaged + LISTENING < at < asked for number, at in raw['heard'])
                for _, engaged, asked, _ in tries if engaged is not None)
    return [Result(raw['scene'], 'emergency stop in force within %.0f ms' % (1e3 * ESTOP_WITHIN), len(times),
                   statistics(times), '%.2f %%' % (100 * share), at_least(ESTOP_SHARE), share >= ESTOP_SHARE),
            Result(raw['scene'], 'commands in force meanwhile', len(times), (), str(moved), '0', not moved),
            Result(raw['scene'], 'release', len(released), statistics(released), '', '', True)]


def calls(raw: Raw) -> List[Result]:
    """`raw['calls']`: as of Teleoperator.call; `raw['executed']`: contents"""
    executed: Dict[str, int] = {}
    for content in raw['executed']:
        executed[content] = executed.get(content, 0) + 1
    twice = sum(count > 1 for count in executed.values())
    answered = [content for content, _, _, failed in raw['calls'] if not failed]
    unexecuted = sum(content not in executed for content in answered)
    times = statistics([ended - begun for _, begun, ended, failed in raw['calls'] if not failed])
    count = len(raw['calls'])
    return [Result(raw['scene'], 'executed twice, or answered and not executed', count, (),
                   '%d, %d' % (twice, unexecuted), '0, 0', not (twice or unexecuted) and count > 0),
            Result(raw['scene'], 'reported as failed', count, (), str(count - len(answered)), '', True),
            Result(raw['scene'], 'answer', len(answered), times, '', 'median ≤ %.0f ms' % (1e3 * CALL_MEDIAN),
                   bool(times) and times[0] <= CALL_MEDIAN)]


def reliable(raw: Raw) -> List[Result]:
    """Messages that all arrive."""
    lost, twice, late = delivery(raw)
    times = ages([(number + 1, at) for number, at in raw['sent']], [(number + 1, at) for number, at in raw['heard']])
    return [Result(raw['scene'], 'lost, twice, out of order', len(raw['sent']), statistics(times),
                   '%d, %d, %d' % (lost, twice, late), '0, 0, 0', not (lost or twice or late) and len(times) > 0)]


def delivery(raw: Raw) -> Tuple[int, int, int]:
    """Messages lost, repeated, and out of order."""
    numbers = [number for number, _ in raw['heard']]
    late = sum(later < earlier for earlier, later in zip(numbers, numbers[1:]))
    return len({number for number, _ in raw['sent']} - set(numbers)), len(numbers) - len(set(numbers)), late


def given_up(raw: Raw) -> List[Result]:
    """Messages during a cut that lasts longer than they may; `raw['said']`: what the nodes wrote about it."""
    lost, twice, late = delivery(raw)
    heard = {number for number, _ in raw['heard']}
    outside = [number for number, at in raw['sent'] if not raw['cut'] - raw['max_age'] <= at <= raw['restored']]
    missing = sum(number not in heard for number in outside)
    return [Result(raw['scene'], 'given up, those of the cut only; twice, out of order', len(raw['sent']), (),
                   '%d, others: %d; %d, %d' % (lost, missing, twice, late), 'some, others: 0; 0, 0',
                   lost > 0 and not (missing or twice or late)),
            Result(raw['scene'], 'said so', len(raw['said']), (), (raw['said'] or ['no'])[0], 'yes',
                   bool(raw['said']))]


def shared_air(idle: Raw, filled: Raw) -> List[Result]:
    """Commands on an air that images fill, against those on an idle one."""
    before, after = (statistics(ages(raw['sent'], raw['heard'])) for raw in (idle, filled))
    limit = before[1] + AIR_SLACK if before else 0.0
    used = 'images and commands use %.0f %% of the air' % (100 * filled['state']['used'])
    return [Result(filled['scene'], 'age, against the idle link', len(filled['sent']), after, used,
                   'p99 ≤ %.0f ms' % (1e3 * limit),
                   bool(after) and after[1] <= limit)]


def failed(raw: Raw) -> List[Result]:
    """A scene that could not be measured."""
    return [Result(raw['scene'], 'measured', 0, (), raw['error'], 'yes', False)]


KINDS: Dict[str, Callable[[Raw], List[Result]]] = {
    'commands': commands, 'stops': stops, 'estops': estops, 'calls': calls, 'reliable': reliable,
    'given up': given_up, 'failed': failed}


def results(raws: Sequence[Raw]) -> List[Result]:
    """The lines of all scenes."""
    found = [result for raw in raws for result in KINDS[raw['kind']](raw)]
    airs = {raw['air']: raw for raw in raws if 'air' in raw}
    return found + (shared_air(airs['idle'], airs['filled']) if len(airs) == 2 else [])
