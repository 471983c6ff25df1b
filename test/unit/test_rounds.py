# SPDX-License-Identifier: BSD-3-Clause
from types import SimpleNamespace

import numpy as np
import pytest

from smokebot_udp.codecs.concealment.fill import nearest
from smokebot_udp.codecs.wire.grid import fit
from smokebot_udp.codecs.wire.partial_image import Picture
from smokebot_udp.streams.pictures import RESTART
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


def test_each_round_is_shown_when_its_time_has_come(rounds):
    Sender(rounds).send(1 * S, 7, range(16), now=10.0)
    rounds.poll(20.0)
    Sender(rounds).send(2 * S, 7, [3], now=30.0)    # what it repeats counts as well
    assert rounds.deadline == 30.0 + QUIET and rounds.poll(30.05) is None
    assert rounds.poll(30.0 + QUIET)[0].stamp == 2 * S


def test_a_map_whose_stamp_stays_is_not_late_for_ever(rounds):
    """A latched map keeps its stamp; where the robot's clock was set back a little, that is older for good."""
    Sender(rounds).send(10 * S, 7, range(16), now=10.0)
    Sender(rounds).send(9 * S, 9, range(16), now=10.0 + RESTART - 0.1)
    assert rounds.dropped['late'] == 16
    Sender(rounds).send(9 * S, 9, range(16), now=10.0 + RESTART)
    head, grid = rounds.poll(20.0)
    assert head.stamp == 9 * S and (grid.items(nearest) == 9).all()


def test_late_segments_of_a_map_elsewhere_change_nothing(rounds):
    Sender(rounds).send(10 * S, 7, range(16), now=10.0)
    Sender(rounds).send(9 * S, 9, range(16), now=10.1, place='there')
    assert rounds.dropped['late'] == 16 and (rounds.poll(11.0)[1].items(nearest) == 7).all()


def test_what_contradicts_neither_ends_a_map_nor_costs_its_batch(rounds):
    Sender(rounds).send(1 * S, 7, range(16), now=10.0)
    Sender(rounds).send(3 * S, 9, [16, 99], now=10.1, place='there')
    rounds.add(SimpleNamespace(stamp=3 * S), 'nowhere', lambda: Picture(0, 4, 2, CELL),
               (np.arange(3), np.ones(3), np.zeros((3, 1))), 10.1)
    Sender(rounds).send(2 * S, 8, [5, 99], now=10.2)
    assert rounds.dropped == {'contradiction': 3, 'picture': 3}
    head, grid = rounds.poll(11.0)
    assert head.stamp == 2 * S and sorted(grid.items(nearest).ravel()) == [7] * 15 + [8]


@pytest.mark.parametrize('seed', range(5))
def test_of_a_map_in_real_segments_half_lost_every_cell_comes(rounds, seed):
    """Ten rounds leave a segment out once in a thousand; 25 do not leave out one of these 52."""
    random = np.random.RandomState(seed)
    cells = random.randint(-1, 101, (230, 270)).astype(np.int8)
    _, cut, per_segment = fit(230, 270, 1390, 1300, 256)
    payloads = cut.split(cells).reshape(len(cut), -1).view(np.uint8)
    whole = len(cut) // per_segment * per_segment
    segments = payloads[:whole].reshape(whole // per_segment, -1)
    shares = []
    for k in range(25):
        came = np.flatnonzero(random.rand(len(segments)) < 0.5)
        last = (np.array([cut.order[whole]]), np.array([len(cut) - whole]), payloads[whole:].reshape(1, -1)
                ) if whole < len(cut) and random.rand() < 0.5 else None
        for batch in (cut.order[came * per_segment], np.full(len(came), per_segment), segments[came]), last:
            if batch is not None:
                rounds.add(SimpleNamespace(stamp=k * S), 'here', lambda: Picture(230, 270, cut.depth, CELL), batch,
                           float(k))
        shares.append(rounds.poll(k + 0.5)[1].completeness)
    assert 0.3 < shares[0] < 0.7 and shares == sorted(shares) and shares[-1] == 1.0
    assert (rounds._map.items(nearest).view(np.int8) == cells).all()
