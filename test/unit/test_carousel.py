# SPDX-License-Identifier: BSD-3-Clause
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from smokebot_udp.codecs.concealment.fill import nearest
from smokebot_udp.codecs.wire.grid import fit
from smokebot_udp.codecs.wire.partial_image import PartialImage
from smokebot_udp.streams.carousel import QUIET, Carousel
from smokebot_udp.streams.frame_assembler import RESTART

CELL = np.dtype('u1')
S = 10 ** 9


def begin(head: SimpleNamespace) -> PartialImage:
    """A 4 by 4 map in 16 subimages of one cell; ValueError for a head that says `impossible`."""
    if head.impossible:
        raise ValueError('no such map')
    return PartialImage(4, 4, 2, CELL)


class Sender:
    def __init__(self, carousel: Any) -> None:
        self.carousel = carousel

    def send(self, stamp: int, value: int, indexes: Any, now: float, place: str = 'here',
             impossible: bool = False) -> None:
        indexes = np.array(indexes)
        payload = np.full((len(indexes), 1), value, np.uint8)
        self.carousel.add(SimpleNamespace(stamp=stamp, impossible=impossible), place,
                          (indexes, np.ones(len(indexes), int), payload), now)


@pytest.fixture
def carousel() -> Any:
    return Carousel(begin, max_wait=0.5)


def test_the_map_is_shown_when_a_cycle_pauses(carousel: Any) -> None:
    Sender(carousel).send(1 * S, 7, range(8), now=10.0)
    assert carousel.deadline() == 10.0 + QUIET and carousel.poll(10.0) is None
    head, grid = carousel.poll(10.0 + QUIET)
    assert head.stamp == 1 * S and grid.completeness == 0.5
    assert carousel.deadline() is None and carousel.poll(99.0) is None


def test_it_is_shown_after_max_wait_at_the_latest(carousel: Any) -> None:
    for k in range(10):
        Sender(carousel).send(1 * S, 7, [k], now=10.0 + 0.09 * k)
    assert carousel.deadline() == 10.5


def test_cycles_complete_each_other_and_newer_cells_count(carousel: Any) -> None:
    Sender(carousel).send(1 * S, 7, range(8), now=10.0)
    Sender(carousel).send(2 * S, 9, range(4, 16), now=11.0)
    head, grid = carousel.poll(12.0)
    assert grid.complete and head.stamp == 2 * S
    assert sorted(grid.items(nearest).ravel()) == [7] * 4 + [9] * 12


def test_a_map_elsewhere_begins_anew(carousel: Any) -> None:
    Sender(carousel).send(1 * S, 7, range(16), now=10.0)
    Sender(carousel).send(2 * S, 9, [3], now=11.0, place='there')
    assert carousel.poll(12.0)[1].completeness == 1 / 16


def test_late_segments_change_nothing_but_an_older_clock_does(carousel: Any) -> None:
    Sender(carousel).send(10 * S, 7, range(16), now=10.0)
    Sender(carousel).send(9 * S, 9, range(16), now=10.1)
    assert carousel.dropped['late'] == 16
    Sender(carousel).send(1 * S, 5, range(16), now=10.2)
    assert (carousel.poll(11.0)[1].items(nearest) == 5).all()


def test_what_contradicts_is_counted(carousel: Any) -> None:
    Sender(carousel).send(1 * S, 7, [16, 99], now=10.0)
    assert carousel.dropped['contradiction'] == 2 and carousel.deadline() is None
    Sender(carousel).send(1, 7, range(3), now=10.0, place='there', impossible=True)
    assert carousel.dropped['impossible head'] == 3


def test_ten_cycles_at_half_loss_bring_nearly_all(carousel: Any) -> None:
    random = np.random.RandomState(1)
    for k in range(10):
        Sender(carousel).send(1 * S, 7, np.flatnonzero(random.rand(16) < 0.5), now=10.0 + k)
    assert carousel.poll(99.0)[1].complete


def test_each_cycle_is_shown_in_time(carousel: Any) -> None:
    Sender(carousel).send(1 * S, 7, range(16), now=10.0)
    carousel.poll(20.0)
    Sender(carousel).send(2 * S, 7, [3], now=30.0)    # what it repeats counts as well
    assert carousel.deadline() == 30.0 + QUIET and carousel.poll(30.05) is None
    assert carousel.poll(30.0 + QUIET)[0].stamp == 2 * S


def test_a_map_whose_stamp_stays_is_not_late_for_ever(carousel: Any) -> None:
    """A latched map keeps its stamp; where the robot's clock was set back a little, that is older for good."""
    Sender(carousel).send(10 * S, 7, range(16), now=10.0)
    Sender(carousel).send(9 * S, 9, range(16), now=10.0 + RESTART - 0.1)
    assert carousel.dropped['late'] == 16
    Sender(carousel).send(9 * S, 9, range(16), now=10.0 + RESTART)
    head, grid = carousel.poll(20.0)
    assert head.stamp == 9 * S and (grid.items(nearest) == 9).all()


def test_late_segments_of_a_map_elsewhere_change_nothing(carousel: Any) -> None:
    Sender(carousel).send(10 * S, 7, range(16), now=10.0)
    Sender(carousel).send(9 * S, 9, range(16), now=10.1, place='there')
    assert carousel.dropped['late'] == 16 and (carousel.poll(11.0)[1].items(nearest) == 7).all()


def test_what_contradicts_neither_ends_a_map_nor_costs_its_batch(carousel: Any) -> None:
    Sender(carousel).send(1 * S, 7, range(16), now=10.0)
    Sender(carousel).send(3 * S, 9, [16, 99], now=10.1, place='there')
    Sender(carousel).send(3 * S, 9, range(3), now=10.1, place='nowhere', impossible=True)
    Sender(carousel).send(2 * S, 8, [5, 99], now=10.2)
    assert carousel.dropped == {'contradiction': 3, 'impossible head': 3}
    head, grid = carousel.poll(11.0)
    assert head.stamp == 2 * S and sorted(grid.items(nearest).ravel()) == [7] * 15 + [8]


@pytest.mark.parametrize('seed', range(5))
def test_of_a_map_in_real_segments_half_lost_every_cell_comes(seed: int) -> None:
    """Ten cycles leave a segment out once in a thousand; 25 do not leave out one of these 52."""
    random = np.random.RandomState(seed)
    cells = random.randint(-1, 101, (230, 270)).astype(np.int8)
    _, cut, per_segment = fit(230, 270, 1390, 1300, 256)
    carousel = Carousel(lambda head: PartialImage(230, 270, cut.depth, CELL), max_wait=0.5)
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
                carousel.add(SimpleNamespace(stamp=k * S), 'here', batch, float(k))
        _, grid = carousel.poll(k + 0.5)
        shares.append(grid.completeness)
    assert 0.3 < shares[0] < 0.7 and shares == sorted(shares) and shares[-1] == 1.0
    assert (grid.items(nearest).view(np.int8) == cells).all()
