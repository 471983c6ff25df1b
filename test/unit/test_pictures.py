# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest

from smokebot_udp.codecs.wire.partial_image import ENDING, Picture
from smokebot_udp.streams.pictures import QUIET, PictureSequence

S = 10 ** 9
SIZE = 64            # 64 subimages of one pixel


class Feed:
    """Pictures of 8 x 8 mono8 pixels at depth 3, sent pixel by pixel."""

    def __init__(self, max_wait=0.2):
        self.sequence = PictureSequence(max_wait)

    def __call__(self, stamp, positions, now, fits=True, value=None):
        positions = np.asarray(positions)
        payloads = np.full((len(positions), 1), stamp // S % 256 if value is None else value, np.uint8)
        return [(dated.stamp, int(dated.picture.have.sum())) for dated in self.sequence.add(
            stamp, lambda: Picture(8, 8, 3, np.dtype('u1'), SIZE), lambda picture: fits,
            (positions, np.ones(len(positions), int), payloads), now)]

    def poll(self, now):
        dated = self.sequence.poll(now)
        return dated and (dated.stamp, int(dated.picture.have.sum()))


def test_complete_pictures_come_at_once():
    feed = Feed()
    assert feed(1 * S, range(40), 0.0) == []
    assert feed(1 * S, range(40, 64), 0.01) == [(1 * S, 64)]
    assert feed.sequence.deadline is None


def test_a_newer_stamp_ends_the_picture():
    feed = Feed()
    feed(1 * S, range(10), 0.0)
    assert feed(2 * S, range(5), 0.1) == [(1 * S, 10)]
    assert feed.poll(0.1) is None


def test_one_batch_may_end_two_pictures():
    feed = Feed()
    feed(1 * S, range(10), 0.0)
    assert feed(2 * S, range(64), 0.1) == [(1 * S, 10), (2 * S, 64)]


def test_max_wait():
    feed = Feed(max_wait=0.2)
    feed(1 * S, range(10), 5.0)
    feed(1 * S, range(10, 20), 5.15)
    assert feed.sequence.deadline == pytest.approx(5.2)
    assert feed.poll(5.19) is None
    assert feed.poll(5.2) == (1 * S, 20)
    assert feed.poll(5.3) is None


def test_what_comes_late_disturbs_nothing():
    feed = Feed()
    feed(1 * S, range(10), 0.0)
    assert feed(2 * S, range(20), 0.1) == [(1 * S, 10)]
    assert feed(1 * S, range(10, 64), 0.11) == []
    assert feed.sequence.dropped['late'] == 54
    assert feed(2 * S, range(20, 64), 0.12) == [(2 * S, 64)]
    assert feed(2 * S, range(64), 0.13) == []       # of a picture that was shown
    assert feed.sequence.dropped['late'] == 54 + 64


def test_the_end_waits_only_for_what_was_overtaken():
    feed = Feed()
    feed(1 * S, range(SIZE - ENDING), 0.0)
    assert feed.sequence.deadline == pytest.approx(0.2)
    feed(1 * S, [SIZE - 1], 0.03)
    assert feed.sequence.deadline == pytest.approx(0.03 + QUIET)
    feed(1 * S, [SIZE - 3], 0.04)
    assert feed.sequence.deadline == pytest.approx(0.04 + QUIET)
    assert feed.poll(0.04 + QUIET) == (1 * S, SIZE - 2)


def test_a_source_whose_clock_was_set_back_goes_on():
    feed = Feed()
    feed(1000 * S, range(64), 0.0)
    assert feed(10 * S, range(64), 0.1) == [(10 * S, 64)]
    assert feed(11 * S, range(64), 0.2) == [(11 * S, 64)]


def test_a_stamp_from_the_future_does_not_freeze_the_picture():
    feed = Feed()
    feed(100 * S, range(10), 0.0)
    feed(4000000000 * S, [0], 0.01)
    assert feed(100 * S + S // 10, range(64), 0.1) == [(4000000000 * S, 1), (100 * S + S // 10, 64)]


def test_segments_that_fit_nothing_begin_no_picture():
    feed = Feed()
    feed(1 * S, range(10), 0.0)
    assert feed(2 * S, [64, 9999], 0.01) == []
    assert feed.sequence.dropped['contradiction'] == 2
    assert feed(1 * S, range(10, 64), 0.02) == [(1 * S, 64)]


def test_contradictions_and_impossible_pictures_are_counted():
    feed = Feed()
    feed(1 * S, range(10), 0.0)
    assert feed(1 * S, range(10, 20), 0.01, fits=False) == []
    assert feed(1 * S, [70, 71], 0.01) == []
    assert feed.sequence.dropped['contradiction'] == 12

    def impossible():
        raise ValueError('height is 0')
    assert feed.sequence.add(2 * S, impossible, None, (np.arange(3), None, None), 0.02) == []
    assert feed.sequence.dropped['picture'] == 3
    assert feed.poll(0.2) == (1 * S, 10)            # the picture in progress stands
