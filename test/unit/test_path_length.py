# SPDX-License-Identifier: BSD-3-Clause
"""Paths that drop long datagrams without a word, simulated: how soon that is known, and how soon the hole is gone."""
import random
from typing import Dict, List, Optional, Tuple

import pytest

from smokebot_udp.congestion.path_length import ANSWER_BITS, LENGTHS, SHORT, SHORT_PROBES, PathLength

LONGEST = 1472
STEP = 0.02
"""[s]"""

Flow = Tuple[str, int, int, float]
"""Name, length [byte], datagrams of a message, period of the messages [s]."""

CAMERA, CLOUD, THERMAL, TF, STATUS = ('camera/layers', 1472, 12, 0.1), ('lidar', 1450, 8, 0.1), (
    'thermal/layers', 900, 5, 0.1), ('tf', 300, 1, 0.05), ('status', 400, 1, 1.0)


class Path:
    """A robot that sends, a path with a hole, and an operator that reports.

    :param hole: longer datagrams are dropped; may be changed
    :param loss: of the others each way
    """

    def __init__(self, flows: List[Flow], hole: Optional[int] = None, loss: float = 0.0, delay: float = 0.03,
                 seed: int = 0, longest: int = LONGEST) -> None:
        self.flows, self.hole, self.loss, self.delay = flows, hole, loss, delay
        self.length, self.now = PathLength(longest, 0.0), 0.0
        self.probes: List[Tuple[float, int]] = []
        self._chance = random.Random(seed)
        self.received: Dict[str, int] = {}
        self._due = {flow[0]: 0.0 for flow in flows}
        self._numbers, self._newest, self._bits = 0, 0, 0
        self._events: List[Tuple[float, str, object]] = []
        self._report_due = 0.0

    def passes(self, size: int) -> bool:
        return (self.hole is None or size <= self.hole) and self._chance.random() >= self.loss

    def run(self, seconds: float) -> None:
        end = self.now + seconds
        while self.now < end - 1e-9:
            self.now += STEP
            self._step()

    def _step(self) -> None:
        self._send()
        self._probe()
        for event in [event for event in self._events if event[0] <= self.now]:
            self._events.remove(event)
            if event[1] == 'report':
                self.length.reported(event[2], self.now)    # type: ignore[arg-type]
            else:
                self.length.answered(*event[2], self.now)   # type: ignore[misc]

    def _send(self) -> None:
        for name, size, count, period in self.flows:
            if self.now >= self._due[name]:
                self._due[name] = self.now + period
                used = min(size, self.length.length)
                self.length.sent(name, count, used, self.now)
                came = sum(self.passes(used) for _ in range(count))
                if came:
                    self.received[name] = self.received.get(name, 0) + came
        if self.now >= self._report_due:
            self._report_due = self.now + 0.1
            if self._chance.random() >= self.loss:
                self._events.append((self.now + 2 * self.delay, 'report', dict(self.received)))

    def _probe(self) -> None:
        length = self.length.probe(self.now)
        if length is not None:
            self.probes.append((self.now, length))
            self.length.probed(self._numbers + 1)
            for size in (length, *[SHORT] * SHORT_PROBES):
                self._numbers += 1
                if self.passes(size):
                    self._bits = (self._bits << (self._numbers - self._newest) | 1) & ((1 << ANSWER_BITS) - 1)
                    self._newest = self._numbers
                    if self._chance.random() >= self.loss:
                        self._events.append((self.now + 2 * self.delay, 'answer', (self._newest, self._bits)))

    def until(self, condition: object, limit: float) -> float:
        """How long it took [s]."""
        begun = self.now
        while not condition():      # type: ignore[operator]
            assert self.now < begun + limit, (self.length.length, self.length.hole)
            self.run(STEP)
        return self.now - begun


@pytest.mark.parametrize('loss, most', [(0.0, 1.5), (0.2, 1.7), (0.5, 3.0)])
@pytest.mark.parametrize('begins', [0.0, 5.0], ids=['from the start', 'later'])
def test_long_datagrams_that_do_not_pass_are_noticed_within_seconds(loss: float, most: float, begins: float) -> None:
    times = []
    for seed in range(20):
        path = Path([CAMERA, CLOUD, THERMAL, TF, STATUS], loss=loss, seed=seed)
        path.run(begins)
        path.hole = 1172
        times.append(path.until(lambda path=path: path.length.length <= 1172, 20.0))
    assert sorted(times)[18] <= most


@pytest.mark.parametrize('hole', [1172, 1200, 1392, 1400, 1464, 1471, 900, 548])
@pytest.mark.parametrize('loss', [0.0, 0.3])
def test_the_longest_usual_length_that_passes_is_found(hole: int, loss: float) -> None:
    path = Path([CAMERA, CLOUD, TF, STATUS], hole, loss)
    path.run(20.0)
    assert path.length.hole and path.length.length == max(length for length in LENGTHS if length <= hole)


def test_what_passes_everywhere_but_is_longer_than_all_usual_lengths() -> None:
    path = Path([('camera/layers', 8900, 3, 0.1), TF], None, 0.2, longest=8972)
    path.run(20.0)
    assert path.length.length == 8972 and not path.length.hole
    path.hole = 1472
    path.until(lambda: path.length.hole, 5.0)
    path.run(10.0)
    assert path.length.length == 1472


@pytest.mark.parametrize('loss', [0.0, 0.3])
def test_the_hole_goes(loss: float) -> None:
    path = Path([CAMERA, CLOUD, TF, STATUS], 1172, loss)
    path.run(10.0)
    path.hole = None
    assert path.until(lambda: not path.length.hole, 40.0) <= (7.0 if not loss else 40.0)
    assert path.length.length == LONGEST
    begun = len(path.probes)
    path.run(60.0)
    assert not path.length.hole and len(path.probes) - begun <= 6


def test_the_hole_becomes_smaller_and_larger() -> None:
    path = Path([CAMERA, CLOUD, TF, STATUS], 1172)
    path.run(10.0)
    path.hole = 1400
    path.until(lambda: path.length.length == 1392, 40.0)
    path.run(30.0)
    path.hole = 600
    path.until(lambda: path.length.length == 548, 4.0)
    path.hole = 1250
    path.until(lambda: path.length.length == 1232, 60.0)


@pytest.mark.parametrize('loss', [0.0, 0.2, 0.5, 0.8, 0.95])
def test_losses_are_no_hole(loss: float) -> None:
    for seed in range(10):
        path = Path([CAMERA, CLOUD, TF, STATUS], None, loss, seed=seed)
        path.run(60.0)
        assert not path.length.hole, seed


def test_bursts_of_losses_are_no_hole() -> None:
    for seed in range(10):
        path, chance = Path([CAMERA, CLOUD, TF, STATUS], seed=seed), random.Random(seed)
        for _ in range(60):
            path.loss = 1.0
            path.run(chance.choice((0.1, 0.5, 1.0)))
            path.loss = 0.1
            path.run(1.0)
        assert not path.length.hole


def test_where_all_arrives_nothing_is_probed() -> None:
    for flows in ([CAMERA, CLOUD, TF, STATUS], [TF, STATUS], [THERMAL]):
        path = Path(flows)
        path.run(60.0)
        assert not path.probes
    path = Path([CAMERA, TF], None, 0.5)
    path.run(60.0)
    assert len(path.probes) <= 6


def test_a_stream_that_the_operator_does_not_have_costs_a_probe_now_and_then() -> None:
    path = Path([TF, STATUS, ('elsewhere', 1472, 10, 0.1)])
    received = path.received
    path.run(0.1)
    path.hole = None
    for _ in range(600):
        received.pop('elsewhere', None)
        path.run(0.1)
    assert not path.length.hole and len(path.probes) <= 12


def test_an_operator_that_does_not_answer_is_asked_rarely() -> None:
    path = Path([CAMERA, TF])
    path.loss = 1.0
    path.run(120.0)
    assert not path.length.hole and len(path.probes) <= 40 * 120 / 15
