# SPDX-License-Identifier: BSD-3-Clause
from types import SimpleNamespace
from typing import Any, List, Optional, Tuple

import numpy as np
import pytest

from smokebot_udp.codecs.wire.partial_image import PartialImage
from smokebot_udp.streams.frame_assembler import (
    MAX_FINISHED,
    MAX_REORDERING,
    FrameAssembler,
    FrameAssemblers,
)
from smokebot_udp.streams.frame_end import FIRST_MARGIN
from smokebot_udp.streams.segments import MAX_SOURCES

S = 10 ** 9
SIZE = 64            # 64 subimages of one pixel


def begin(head: SimpleNamespace) -> PartialImage:
    """8 x 8 mono8 pixels at depth 3; ValueError for a head that says `impossible`."""
    if head.says == 'impossible':
        raise ValueError('height is 0')
    return PartialImage(8, 8, 3, np.dtype('u1'), SIZE)


class Feed:
    """Images that are sent pixel by pixel."""

    def __init__(self, max_wait: float = 0.2) -> None:
        self.frames = FrameAssembler(begin, max_wait)

    def __call__(self, stamp: int, positions: Any, now: float, says: str = '') -> List[Tuple[int, int]]:
        """Add segments; what is finished then: [(stamp, subimages received), ...]."""
        positions = np.asarray(positions)
        payloads = np.full((len(positions), 1), stamp // S % 256, np.uint8)
        self.frames.add(SimpleNamespace(stamp=stamp, says=says), (positions, np.ones(len(positions), int), payloads),
                        now)
        return list(iter(lambda: self.poll(now), None))

    def poll(self, now: float) -> Optional[Tuple[int, int]]:
        frame = self.frames.poll(now)
        return None if frame is None else (frame.head.stamp, int(frame.content.have.sum()))


def test_a_complete_frame_is_finished_at_once() -> None:
    feed = Feed()
    assert feed(1 * S, range(40), 0.0) == []
    assert feed(1 * S, range(40, 64), 0.01) == [(1 * S, 64)]
    assert feed.frames.deadline() is None


def test_a_frame_begins_with_a_segment_that_fits() -> None:
    began: List[int] = []
    frames = FrameAssembler(begin, 0.2, lambda head: began.append(head.stamp))

    def add(stamp: int, position: int, says: str = '') -> None:
        frames.add(SimpleNamespace(stamp=stamp, says=says), (np.array([position]), np.ones(1, int),
                                                             np.zeros((1, 1), np.uint8)), 0.0)
    add(1 * S, 0, 'impossible')
    add(1 * S, SIZE)
    assert began == [] and frames.deadline() is None
    add(1 * S, 0)
    add(1 * S, 1)
    add(2 * S, 0)
    assert began == [1 * S, 2 * S]


def test_a_newer_stamp_finishes_the_frame() -> None:
    feed = Feed()
    feed(1 * S, range(10), 0.0)
    assert feed(2 * S, range(5), 0.1) == [(1 * S, 10)]
    assert feed.poll(0.1) is None


def test_one_batch_may_finish_two_frames() -> None:
    feed = Feed()
    feed(1 * S, range(10), 0.0)
    assert feed(2 * S, range(64), 0.1) == [(1 * S, 10), (2 * S, 64)]


def test_max_wait() -> None:
    feed = Feed(max_wait=0.2)
    feed(1 * S, range(10), 5.0)
    feed(1 * S, range(10, 20), 5.15)
    assert feed.frames.deadline() == pytest.approx(5.2)
    assert feed.poll(5.19) is None
    assert feed.poll(5.2) == (1 * S, 20)
    assert feed.poll(5.3) is None


def test_late_segments_change_nothing() -> None:
    feed = Feed()
    feed(1 * S, range(10), 0.0)
    assert feed(2 * S, range(20), 0.1) == [(1 * S, 10)]
    assert feed(1 * S, range(10, 64), 0.11) == []
    assert feed.frames.dropped['late'] == 54
    assert feed(2 * S, range(20, 64), 0.12) == [(2 * S, 64)]
    assert feed(2 * S, range(64), 0.13) == []       # of a frame that is complete
    assert +feed.frames.dropped == {'late': 54, 'not needed': 64}
    assert feed(3 * S, [63], 0.2) == [] and feed.poll(0.4) == (3 * S, 1)
    assert feed(3 * S, range(63), 0.41) == []       # of one that was finished without them
    assert +feed.frames.dropped == {'late': 54 + 63, 'not needed': 64}


def two_paths(feed: Feed, frames: range, lost: bool = False) -> List[Tuple[int, Tuple[int, int], float]]:
    """Frames of 0.1 s, a segment each 1.5 ms; each fourth one comes by a slower path, 30 ms later, or is lost.

    :return: [(number of frame, (stamp, segments), when), ...]
    """
    events = sorted((0.1 * number + 0.0015 * place + 0.03 * (place % 4 == 3), number, place)
                    for number in frames for place in range(64) if not (lost and place % 4 == 3))
    shown = []
    for now, number, place in events:
        deadline = feed.frames.deadline()
        while deadline is not None and deadline <= now:
            finished = feed.poll(deadline)
            assert finished is not None
            shown.append((finished[0] * 10 // S, finished, deadline))
            deadline = feed.frames.deadline()
        shown += [(one[0] * 10 // S, one, now) for one in feed(number * S // 10, [place], now)]
    return shown


def test_what_comes_by_a_slower_path_is_waited_for_beside_the_next_frame() -> None:
    shown = two_paths(Feed(), range(1, 30))
    assert [number for number, *_ in shown] == list(range(1, 30))
    assert [count for _, (_, count), _ in shown[4:]] == [64] * 25
    assert all(when < 0.1 * number + 0.0015 * 64 + 0.031 for number, _, when in shown)


def test_one_frame_that_came_late_is_an_exception() -> None:
    feed = Feed()
    feed(1 * S, range(10), 0.0)
    feed(2 * S, range(10), 0.1)
    assert feed(1 * S, [20], 0.11) == [] and feed.frames.dropped['late'] == 1
    assert feed(3 * S, range(10), 0.115) == [(2 * S, 10)]      # at once


def test_lost_segments_are_not_waited_for_beside_the_next_frame_where_none_comes_late() -> None:
    feed = Feed()
    two_paths(feed, range(1, 20))
    shown = two_paths(feed, range(20, 60), lost=True)
    beyond = [when - 0.1 * (number + 1) for number, (_, count), when in shown if number >= 20]
    assert beyond[0] == pytest.approx(0.03, abs=0.01) and max(beyond[20:]) < 0.005


def test_a_frame_that_is_left_open_is_finished_before_the_next_one() -> None:
    feed = Feed()
    two_paths(feed, range(1, 20))
    feed.frames.poll(9.0)
    feed(20 * S // 10, range(0, 40, 2), 9.1)
    assert feed(21 * S // 10, range(10), 9.11) == []
    assert feed(21 * S // 10, range(10, 64), 9.12) == [(20 * S // 10, 20), (21 * S // 10, 64)]
    feed(22 * S // 10, range(0, 40, 2), 9.2)
    assert feed(23 * S // 10, range(10), 9.21) == []
    assert feed(24 * S // 10, range(10), 9.22) == [(22 * S // 10, 20)]


def test_missing_segments_are_waited_for_until_they_are_late() -> None:
    """One every millisecond: each is expected at its own time, also where later ones came."""
    feed = Feed()
    for k in range(40):
        feed(1 * S, [k], 0.001 * k)
    assert feed.frames.deadline() == pytest.approx(0.063 + FIRST_MARGIN)
    feed(1 * S, [62, 63], 0.0625)
    assert feed.frames.deadline() == pytest.approx(0.0605 + FIRST_MARGIN, abs=0.001)
    assert feed.poll(0.062 + FIRST_MARGIN) == (1 * S, 42)


def test_of_a_single_segment_nothing_follows_before_max_wait() -> None:
    feed = Feed(max_wait=0.2)
    feed(1 * S, [5], 0.0)
    assert feed.frames.deadline() == 0.2


def test_a_forged_segment_of_a_finished_frame_does_not_change_its_end() -> None:
    feed = Feed()
    feed(1 * S, range(60), 0.0)
    assert feed.poll(2 * FIRST_MARGIN) == (1 * S, 60)
    for says, index in ('else', 63), ('', 64), ('', 65535):
        assert feed(1 * S, [index], 0.1, says) == []
    feed(2 * S, range(60), 0.3)
    assert feed.frames.deadline() == pytest.approx(0.3 + FIRST_MARGIN)


def test_a_source_whose_clock_was_set_back_goes_on() -> None:
    feed = Feed()
    feed(1000 * S, range(64), 0.0)
    assert feed(10 * S, range(64), 0.1) == [(10 * S, 64)]
    assert feed(11 * S, range(64), 0.2) == [(11 * S, 64)]


@pytest.mark.parametrize('length', [2, 3, 8, 15])
def test_a_recording_in_a_loop_goes_on(length: int) -> None:
    """Images of 10 Hz: a jump costs MAX_REORDERING and the image that proves it, two where its stamp was the last."""
    feed, shown = Feed(), []
    for number in range(20 * length):
        shown += [(number, stamp) for stamp, _ in feed((number % length + 1) * S // 10, range(64), 0.1 * number)]
    assert max(np.diff([number for number, _ in shown])) <= 10 * MAX_REORDERING + 2
    assert len(shown) >= 20 * length / 4 and 20 * length - shown[-1][0] <= 4


def test_a_clock_that_is_set_back_by_a_second_goes_on() -> None:
    feed = Feed()
    feed(100 * S, range(64), 0.0)
    assert feed(99 * S, range(64), 0.1) == []       # it could be late
    assert feed(99 * S + S // 2, range(64), 0.4) == [(99 * S + S // 2, 64)]
    assert feed(99 * S + S // 10, range(64), 0.5) == []
    assert feed(99 * S + 6 * S // 10, range(64), 0.5) == [(99 * S + 6 * S // 10, 64)]


def test_a_stamp_from_the_future_does_not_stop_the_stream() -> None:
    feed = Feed()
    feed(100 * S, range(10), 0.0)
    feed(4000000000 * S, [0], 0.01)
    assert feed(100 * S + S // 10, range(64), 0.1) == [(4000000000 * S, 1), (100 * S + S // 10, 64)]


def test_segments_that_do_not_fit_begin_no_frame() -> None:
    feed = Feed()
    feed(1 * S, range(10), 0.0)
    assert feed(2 * S, [64, 9999], 0.01) == []
    assert feed.frames.dropped['contradiction'] == 2
    assert feed(1 * S, range(10, 64), 0.02) == [(1 * S, 64)]


def test_contradictions_and_impossible_frames_are_counted() -> None:
    feed = Feed()
    feed(1 * S, range(10), 0.0)
    assert feed(1 * S, range(10, 20), 0.01, says='something else') == []
    assert feed(1 * S, [70, 71], 0.01) == []
    assert feed.frames.dropped['contradiction'] == 12
    assert feed(2 * S, range(3), 0.02, says='impossible') == []
    assert feed.frames.dropped['impossible head'] == 3
    assert feed.poll(0.2) == (1 * S, 10)            # the frame in progress is kept


def test_of_finished_frames_that_nobody_takes_the_newest_are_kept() -> None:
    feed = Feed()
    for stamp in range(1, 6):
        feed.frames.add(SimpleNamespace(stamp=stamp * S, says=''), (
            np.arange(SIZE), np.ones(SIZE, int), np.zeros((SIZE, 1), np.uint8)), 0.0)
    assert feed.frames.deadline() == -np.inf
    assert [feed.poll(0.0) for _ in range(MAX_FINISHED + 1)] == [(4 * S, SIZE), (5 * S, SIZE), None]
    assert feed.frames.dropped['overtaken frame'] == 3


def test_max_wait_changes_in_place() -> None:
    feed = Feed(max_wait=0.2)
    feed(1 * S, [9], 5.0)
    feed.frames.max_wait = 0.5
    assert feed.frames.deadline() == pytest.approx(5.5)


class Sources:
    """Images of several frames, pixel by pixel."""

    def __init__(self) -> None:
        self.frames = FrameAssemblers(begin, 0.2)

    def __call__(self, frame_id: str, positions: Any, now: float, order: int = 1 * S) -> List[Tuple[str, int]]:
        """Add segments of stamp 1 s; what is finished then: [(frame_id, subimages received), ...]."""
        positions = np.asarray(positions)
        self.frames.add(SimpleNamespace(stamp=1 * S, says='', frame_id=frame_id), (
            positions, np.ones(len(positions), int), np.zeros((len(positions), 1), np.uint8)), now, order)
        return self.poll(now)

    def poll(self, now: float) -> List[Tuple[str, int]]:
        found = iter(lambda: self.frames.poll(now), None)
        return [(frame.head.frame_id, int(frame.content.have.sum())) for frame in found]


def test_sources_of_one_stamp_are_told_apart_by_their_frames() -> None:
    feed = Sources()
    for frame_id in ('first', 'last', 'strongest'):
        assert feed(frame_id, range(40), 0.0) == []
    assert feed('last', range(40, 64), 0.01) == [('last', 64)]
    assert feed('first', range(40, 60), 0.01) == []
    assert feed('strongest', range(40, 64), 0.01) == [('strongest', 64)]
    assert feed.frames.deadline() is not None and feed.poll(0.21) == [('first', 60)]
    assert feed.frames.deadline() is None


def test_messages_of_one_stamp_are_told_apart_by_their_order() -> None:
    feed = Sources()
    assert feed('lidar', range(64), 0.0, 7 * S) == [('lidar', 64)]
    assert feed('lidar', range(30), 0.1, 7 * S + 1) == []
    assert feed('lidar', range(64), 0.2, 7 * S + 2) == [('lidar', 30), ('lidar', 64)]
    assert feed('lidar', range(64), 0.2, 7 * S + 1) == [] and feed.frames.dropped['late'] == 64


def test_a_source_that_is_busy_gives_way_to_no_other() -> None:
    feed = Sources()
    feed('true', range(10), 0.0)
    for number in range(MAX_SOURCES + 5):
        feed('source %d' % number, range(10), 0.0)
    assert feed.frames.dropped['too many sources'] == 6 * 10
    assert feed('true', range(10, 64), 0.01) == [('true', 64)]
    assert feed('new', range(10), 0.02) == []       # nor does one just after it
    assert feed.frames.dropped['too many sources'] == 7 * 10
    assert len(feed.poll(1.0)) == MAX_SOURCES - 1
    assert feed('new', range(64), 1.0) == [('new', 64)]


def test_settings_reach_all_sources() -> None:
    feed = Sources()
    feed('early', range(10), 0.0)
    feed.frames.configure(max_wait=0.001, max_finished=1)
    assert feed.frames.deadline() == 0.001
    feed('late', range(10), 0.0)
    assert feed.frames.deadline() == 0.001 and feed.poll(0.001) == [('early', 10), ('late', 10)]
    for order in (2 * S, 3 * S, 4 * S):
        for frame_id in ('early', 'late'):
            feed.frames.add(SimpleNamespace(stamp=1 * S, says='', frame_id=frame_id), (
                np.arange(64), np.ones(64, int), np.zeros((64, 1), np.uint8)), 0.1, order)
    assert feed.poll(0.1) == [('early', 64), ('late', 64)]
