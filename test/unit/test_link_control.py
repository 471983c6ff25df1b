# SPDX-License-Identifier: BSD-3-Clause
"""The robot's and the operator's side of the link's supervision without ROS between them."""
import math
import threading
from types import SimpleNamespace

import pytest
import rospy

from smokebot_udp.congestion.estimator import MBIT, Limits
from smokebot_udp.congestion.feedback import ArrivalMark, Arrivals, Report, StreamArrivals
from smokebot_udp.msg import LinkReport
from smokebot_udp.nodes import link_control
from smokebot_udp.nodes.link_control import GONE, MOST_OPERATORS, LinkControl
from smokebot_udp.nodes.link_reporter import LinkReporter, as_message

LIMITS = Limits(floor=0.1 * MBIT, start=0.5 * MBIT, max_rate=10 * MBIT)
SIZE = 1500


class Outbox:
    """Keeps what its pace is told."""

    def __init__(self):
        self.rates, self.trains = [], []

    def change(self, change):
        change(SimpleNamespace(set_rate=self.rates.append, train=lambda *train: self.trains.append(train)))


@pytest.fixture
def now(monkeypatch):
    """A clock that stands until it is told otherwise: now.time; now.seq datagrams have left."""
    clock = SimpleNamespace(time=1000.0, seq=0)
    monkeypatch.setattr(link_control, 'time', SimpleNamespace(monotonic=lambda: clock.time))
    monkeypatch.setattr(rospy.Time, 'now', lambda: rospy.Time(1))
    return clock


@pytest.fixture
def control(now):
    return made(LIMITS, adapt=True)


def made(limits, adapt):
    """A LinkControl that is not started: no ROS."""
    control = LinkControl(limits, adapt)
    control._outbox, control._status = Outbox(), SimpleNamespace(publish=lambda status: None)
    control._allocation = SimpleNamespace(wanted=30 * MBIT, divide=lambda budget, now: None)
    return control


class Operator:
    """An operator to whom datagrams come after `delay`, so many a second at most."""

    def __init__(self, control, now, name, rate):
        self.control, self.now, self.name, self.rate = control, now, name, rate
        self.arrivals, self.free = Arrivals(lambda: 7), 0.0

    def take(self, seq):
        self.free = max(self.free, self.now.time) + SIZE / self.rate
        self.arrivals.note('thermal', seq, SIZE, self.free + 0.02)

    def report(self, at):
        report = as_message(self.arrivals.report(at))
        report._connection_header = {'callerid': self.name}
        self.control._take(report)


def drive(control, now, operators, seconds):
    """Datagrams leave as fast as the control says; operators report ten times a second."""
    until, next_report = now.time + seconds, now.time + 0.1
    while now.time < until:
        rate = control._outbox.rates[-1] if control._outbox.rates else control.start_rate
        now.seq = seq = now.seq + 1
        control.departed('thermal', seq, 1, SIZE, now.time)
        for operator in operators:
            operator.take(seq)
        now.time += SIZE / rate
        if now.time >= next_report:
            next_report += 0.1
            for operator in operators:
                operator.report(max(now.time, operator.free + 0.02))
            control._poll()


def test_a_report_is_a_message():
    report = Report(5, 123456, [StreamArrivals('thermal', 9, 8, 7777)], [ArrivalMark(0, 9, 1234)])
    message = as_message(report)
    assert isinstance(message, LinkReport) and (message.session, message.clock) == (5, 123456)
    assert [(one.name, one.highest, one.received, one.bytes) for one in message.streams] == [('thermal', 9, 8, 7777)]
    assert [(mark.stream, mark.seq, mark.age) for mark in message.marks] == [(0, 9, 1234)]


def test_the_rate_follows_what_arrives(control, now):
    assert control.start_rate == LIMITS.start
    drive(control, now, [Operator(control, now, '/op', 2 * MBIT)], 8.0)
    assert 0.8 * 2 * MBIT < control._outbox.rates[-1] < 1.2 * 2 * MBIT
    status = control.status(now.time)
    assert status.capacity == pytest.approx(2.0, rel=0.15) and status.state == 'as /op reports'
    assert status.wanted == 30 and status.sent == pytest.approx(2.0, rel=0.2) and status.round_trip > 0.0
    assert control.figures(now.time)[0] is None


def test_a_dip_in_the_rate_does_not_make_streams_coarser(control, now):
    drive(control, now, [Operator(control, now, '/op', 5 * MBIT)], 5.0)
    estimator, budgets = control._operators['/op'].estimator, []
    control._allocation.divide = lambda budget, now: budgets.append(budget)
    estimator.rate, estimator.link.capacity, estimator.poll = 2.5 * MBIT, 5 * MBIT, lambda now: None
    control._poll()
    assert budgets == [5 * MBIT] and control._outbox.rates[-1] == 2.5 * MBIT


def test_of_several_operators_the_worst_link_counts_until_it_is_gone(control, now):
    near, far = Operator(control, now, '/near', 5 * MBIT), Operator(control, now, '/far', 1 * MBIT)
    drive(control, now, [near, far], 8.0)
    assert control._outbox.rates[-1] < 1.2 * MBIT and control.status(now.time).state == 'as /far reports'
    drive(control, now, [near], GONE + 8.0)
    assert control.status(now.time).state == 'as /near reports' and control._outbox.rates[-1] > 3 * MBIT


def test_without_reports_the_rate_falls_and_diagnostics_say_so(control, now):
    drive(control, now, [Operator(control, now, '/op', 5 * MBIT)], 5.0)
    before = control._outbox.rates[-1]
    drive(control, now, [], 0.8)
    assert control._outbox.rates[-1] <= before / 2
    drive(control, now, [], 10.0)
    assert control._outbox.rates[-1] < 1.2 * LIMITS.floor
    problem, values = control.figures(now.time)
    assert problem == values['state'] and problem.startswith('no reports of /op for 1')


def test_nobody_yet(control, now):
    status = control.status(now.time)
    assert status.state == 'no operator has reported yet' and math.isnan(status.capacity) and status.rate == 0.5


def test_a_fixed_rate_stays(now):
    control = made(LIMITS, adapt=False)
    assert control.start_rate == LIMITS.max_rate
    drive(control, now, [Operator(control, now, '/op', 20 * MBIT)], 1.0)
    assert set(control._outbox.rates) == {LIMITS.max_rate} and control.status(now.time).state == 'fixed'
    assert control.status(now.time).capacity > 5        # told all the same


def test_unlimited_is_told_as_zero(now):
    control = made(Limits(max_rate=math.inf), adapt=False)
    assert control.start_rate is None and control.status(now.time).rate == 0


def test_forged_reports_are_counted_and_change_nothing(control, now):
    drive(control, now, [Operator(control, now, '/op', 2 * MBIT)], 5.0)
    rate = control._outbox.rates[-1]
    report = as_message(Report(7, 10 ** 12, [StreamArrivals('thermal', 10 ** 6, 10 ** 6, 10 ** 9)], []))
    report._connection_header = {'callerid': '/op'}
    control._take(report)
    assert control._outbox.rates[-1] == rate
    assert control.figures(now.time)[1]['reports refused, received more than sent'] == 1


def test_who_reports_nothing_that_left_is_no_operator(control, now):
    drive(control, now, [Operator(control, now, '/op', 5 * MBIT)], 5.0)
    rate = control._outbox.rates[-1]
    impossible = Report(7, 10 ** 12, [StreamArrivals('thermal', 10 ** 6, 10 ** 6, 10 ** 9)], [])
    for report in (impossible, Report(8, 10 ** 6, [], [])):
        message = as_message(report)
        message._connection_header = {'callerid': '/stranger'}
        control._take(message)
    control._poll()
    assert rate > 2 * LIMITS.start and control._outbox.rates[-1] >= rate
    assert control.status(now.time).state == 'as /op reports'


def test_operators_without_end_are_not_listened_to(control, now):
    for number in range(MOST_OPERATORS + 5):
        report = as_message(Report(number, 10 ** 6, [], []))
        report._connection_header = {'callerid': '/op%d' % number}
        control._take(report)
    assert len(control._operators) == MOST_OPERATORS
    assert control.figures(now.time)[1]['reports refused, too many operators'] == 5
    now.time += GONE + 1
    control._take(report)
    assert len(control._operators) == 1


def test_what_comes_of_a_robot_that_began_anew_is_counted_anew():
    reporter = LinkReporter.__new__(LinkReporter)       # without its publisher
    sessions = iter(range(10))
    reporter._arrivals, reporter._lock, reporter._connections = Arrivals(lambda: next(sessions)), threading.Lock(), {}
    reporter.arrived('thermal', 4, 500, 500 * SIZE, 500, 1.0)
    before = reporter._arrivals.report(1.0)
    reporter.arrived('thermal', 9, 3, 3 * SIZE, 3, 2.0)     # another connection, far from 4096 numbers behind
    reporter.arrived('thermal', 4, 501, SIZE, 1, 2.1)       # the old one's last
    after = reporter._arrivals.report(2.2)
    assert after.session != before.session
    assert [(one.highest, one.received, one.bytes) for one in after.streams] == [(3, 3, 3 * SIZE)]
