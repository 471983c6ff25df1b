# SPDX-License-Identifier: BSD-3-Clause
"""How long a map takes to an operator over a slow link that loses datagrams and reports alike."""
import random
from typing import Any, List, NamedTuple, Tuple

import needs_numba  # noqa: F401
import numpy as np
import pytest
from map_receiver import MapReceiver, segments_of
from test_tiles_encoder import Robot, building

RATE = 0.45 * 2e6 / 8
"""What a stream of images at 10 Hz leaves of a link of 2 Mbit/s [byte/s]."""
TRANSIT = 0.02
STEP = 0.005


class Times(NamedTuple):
    overview: float
    """When the first datagram of one arrived [s]."""
    complete: float
    sent: int
    """[byte on the air]"""


class Link:
    """A robot, a link of RATE, and an operator who reports ten times a second while something arrives."""

    def __init__(self, seed: int, loss: float) -> None:
        self.robot, self.receiver = Robot(), MapReceiver()
        self.robot.set_loss(loss)
        self._chance, self._loss = random.Random(seed), loss
        self._free = self._due = 0.0
        self._forth: List[Tuple[float, Any]] = []
        self._back: List[Tuple[float, Any]] = []
        self._news, self._reported = False, 0.0

    def show(self, cells: Any, limit: float) -> Times:
        """Send a map until it is shown."""
        began, sent, overview = self.robot.now, 0, float('inf')
        frames = self.robot.take(cells)
        self._due = began + self.robot.encoder.repeat_period(self.robot.settings)
        while self.robot.now < began + limit:
            sent += sum(frame.datagram_size + 28 for frame in frames)
            self._send(frames)
            self.robot.now += STEP
            self._arrive()
            if self.receiver.overviews:
                overview = min(overview, self.robot.now - began)
            if self.receiver.complete and np.array_equal(self.receiver.map, cells):
                return Times(overview, self.robot.now - began, sent)
            frames = self._repeat()
        return Times(overview, float('inf'), sent)

    def settle(self) -> None:
        """Until the robot knows that all is held."""
        for _ in range(int(3.0 / STEP)):
            self.robot.now += STEP
            self._arrive()
            self._send(self._repeat())

    def _repeat(self) -> Any:
        if self.robot.now < self._due or self._free > self.robot.now + STEP:
            return []
        frames = self.robot.encoder.repeat(self.robot.settings, 1472)
        self._due = self.robot.now + self.robot.encoder.repeat_period(self.robot.settings)
        return frames

    def _send(self, frames: Any) -> None:
        for frame in frames:
            self._free = max(self._free, self.robot.now) + (frame.datagram_size + 28) / RATE
            if self._chance.random() >= self._loss:
                self._forth += [(self._free + TRANSIT, segment) for segment in segments_of([frame])]

    def _arrive(self) -> None:
        now = self.robot.now
        for segment in [one for at, one in self._forth if at <= now]:
            self.receiver.receive(segment)
            self._news = True
        self._forth = [item for item in self._forth if item[0] > now]
        if now - self._reported >= (0.1 if self._news else 1.0) and self.receiver.session is not None:
            self._news, self._reported = False, now
            if self._chance.random() >= self._loss:
                self._back.append((now + TRANSIT, self.receiver.holding()))
        for holding in [one for at, one in self._back if at <= now]:
            self.robot.encoder.held('/op', holding)
            self._due = now
        self._back = [item for item in self._back if item[0] > now]


def middle(values: List[float]) -> float:
    return sorted(values)[len(values) // 2]


@pytest.mark.parametrize('loss, overview, complete', [
    (0.0, 0.1, 1.0), (0.2, 0.1, 1.5), (0.5, 0.2, 3.0), (0.8, 0.3, 8.0)])
def test_a_map_appears_in_time(loss: float, overview: float, complete: float) -> None:
    cells = building(945, 1165)
    times = [Link(seed, loss).show(cells, 2 * complete) for seed in range(5)]
    assert middle([one.overview for one in times]) <= overview + TRANSIT
    assert max(one.complete for one in times) <= (complete if loss < 0.8 else 1.5 * complete)
    assert middle([one.complete for one in times]) <= complete
    if not loss:
        assert times[0].sent < 50000


def test_a_change_is_seen_soon_and_costs_little() -> None:
    shown = []
    for seed in range(4):
        link, cells = Link(seed, 0.2), building()
        link.show(cells, 10.0)
        for number in range(5):
            link.settle()
            cells = cells.copy()
            cells[20 + 40 * number:40 + 40 * number, 300:320] = 100
            shown.append(link.show(cells, 5.0))
    assert sorted(one.complete for one in shown)[int(0.95 * len(shown)) - 1] <= 0.3
    assert max(one.sent for one in shown) <= 2000
