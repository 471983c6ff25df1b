# SPDX-License-Identifier: BSD-3-Clause
from types import SimpleNamespace

import numpy as np
import pytest

from smokebot_udp.codecs.fill import nearest
from smokebot_udp.codecs.image import Picture
from smokebot_udp.streams.rounds import QUIET, Rounds

CELL = np.dtype('u1')
S = 10 ** 9


class Sender:
    """A 4 by 4 map in 16 subimages of one cell."""

    def __init__(self, rounds):
        self.rounds = rounds

    def send(self, stamp, value, indexes, now, place='here'):
        indexes = np.array(indexes)
        payload = np.full((len(indexes), 1), value, np.uint8)
        self.rounds.add(SimpleNamespace(stamp=stamp), place, lambda: Picture(4, 4, 2, CELL),
                        (indexes, np.ones(len(indexes), int), payload), now)


@pytest.fixture
def rounds():
    return Rounds(max_wait=0.5)


def test_it_is_shown_when_a_round_pauses(rounds):
    Sender(rounds).send(1 * S, 7, range(8), now=10.0)
    assert rounds.deadline == 10.0 + QUIET and rounds.poll(10.0) is None
    head, grid = rounds.poll(10.0 + QUIET)
    assert head.stamp == 1 * S and grid.completeness == 0.5
    assert rounds.deadline is None and rounds.poll(99.0) is None


def test_it_is_shown_after_max_wait_at_the_latest(rounds):
    for k in range(10):
        Sender(rounds).send(1 * S, 7, [k], now=10.0 + 0.09 * k)
    assert rounds.deadline == 10.5


def test_rounds_complete_each_other_and_newer_cells_count(rounds):
    Sender(rounds).send(1 * S, 7, range(8), now=10.0)
    Sender(rounds).send(2 * S, 9, range(4, 16), now=11.0)
    head, grid = rounds.poll(12.0)
    assert grid.complete and head.stamp == 2 * S
    assert sorted(grid.items(nearest).ravel()) == [7] * 4 + [9] * 12


def test_a_map_elsewhere_begins_anew(rounds):
    Sender(rounds).send(1 * S, 7, range(16), now=10.0)
    Sender(rounds).send(2 * S, 9, [3], now=11.0, place='there')
    assert rounds.poll(12.0)[1].completeness == 1 / 16


def test_late_segments_change_nothing_but_an_older_clock_does(rounds):
    Sender(rounds).send(10 * S, 7, range(16), now=10.0)
    Sender(rounds).send(9 * S, 9, range(16), now=10.1)
    assert rounds.dropped['late'] == 16
    Sender(rounds).send(1 * S, 5, range(16), now=10.2)
    assert (rounds.poll(11.0)[1].items(nearest) == 5).all()


def test_what_contradicts_is_counted(rounds):
    Sender(rounds).send(1 * S, 7, [16, 99], now=10.0)
    assert rounds.dropped['contradiction'] == 2 and rounds.deadline is None

    def impossible():
        raise ValueError('no such map')
    rounds.add(SimpleNamespace(stamp=1), 'there', impossible, (np.arange(3), np.ones(3), np.zeros((3, 1))), 10.0)
    assert rounds.dropped['picture'] == 3


def test_ten_rounds_at_half_loss_bring_nearly_all(rounds):
    random = np.random.RandomState(1)
    for k in range(10):
        Sender(rounds).send(1 * S, 7, np.flatnonzero(random.rand(16) < 0.5), now=10.0 + k)
    assert rounds.poll(99.0)[1].complete
