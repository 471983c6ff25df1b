# SPDX-License-Identifier: BSD-3-Clause
"""When a frame is finished of which datagrams are lost: ages and what comes too late, by simulated arrivals."""
from types import SimpleNamespace
from typing import Any, List, Sequence

import numpy as np
import pytest
from arrivals import Parts, Shown, evenly, jitter, run, share_late
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.streams.frame_assembler import FrameAssembler
from smokebot_udp.streams.frame_end import FIRST_MARGIN, LEAST_MARGIN, FrameEnd


def bursts(count: int, together: int, pace: float) -> Any:
    """`together` datagrams leave at a time."""
    return lambda number: pace * together * (np.arange(count) // together)


def waited(shown: Sequence[Shown], percentile: float) -> float:
    """[s]"""
    return float(np.percentile([frame.waited for frame in shown], percentile))


def wait_beyond(sent: Any, loss: float, percentile: float, **options: Any) -> float:
    """How much longer frames of a calm link take than until their last datagram would have come [s]."""
    shown = run(sent, loss, frames=200, **options)
    assert share_late(shown) == 0.0
    return float(np.percentile([frame.age - sent(0)[-1] for frame in shown], percentile))


def test_the_first_frame_by_hand() -> None:
    end = FrameEnd()
    assert end.given_up(0) == np.inf
    end.add(np.array([2]), 10.0)
    assert end.given_up(3) == np.inf and end.given_up(2) == pytest.approx(10.0 + FIRST_MARGIN)
    end.add(np.array([4, 6]), 10.03)        # the line through (2, 0), (4, 30), (6, 30) ms rises by 7.5 ms
    assert end.pace == pytest.approx(0.0075)
    assert end.given_up(8) == pytest.approx(10.03 + 2 * 0.0075 + FIRST_MARGIN)
    assert end.given_up(5) == pytest.approx(10.03 - 0.0075 + FIRST_MARGIN)


def test_the_pace_of_the_frames_before_serves_a_single_datagram() -> None:
    end = FrameEnd()
    end.add(np.arange(3), 0.0)
    end.add(np.arange(3, 40), 0.1)
    pace = end.pace
    end.begin()
    end.add(np.array([7]), 1.0)
    assert pace is not None and end.pace == pytest.approx(pace)
    assert end.given_up(10) == pytest.approx(1.0 + 3 * pace + end.margin)


@pytest.mark.parametrize('sent, most', [
    (evenly(12, 0.012), 0.004),                 # 1 Mbit/s
    (evenly(40, 0.0006), 0.004),                # 20 Mbit/s
    (bursts(430, 44, 1e-5), 0.004),             # unlimited, by GSO
    (bursts(60, 8, 0.0006), 0.012)])            # the next burst is not known to be the last one
@pytest.mark.parametrize('loss', [0.5, 0.9])
def test_on_a_calm_link_a_frame_ends_when_its_last_datagram_would_have_come(sent: Any, loss: float, most: float
                                                                            ) -> None:
    assert wait_beyond(sent, loss, 50) < most
    if loss < 0.9:
        assert wait_beyond(sent, loss, 99) < 2 * most + 0.002


@pytest.mark.parametrize('sent', [evenly(12, 0.012), evenly(40, 0.0006), bursts(60, 8, 0.0006), evenly(430, 1e-5)])
@pytest.mark.parametrize('loss', [0.0, 0.5, 0.9])
def test_jitter_is_waited_for_and_no_longer(sent: Any, loss: float) -> None:
    """+-10 ms, so datagrams overtake each other; a frame may end early, but hardly any datagram is lost by it."""
    shown = run(sent, loss, jitter(0.010), frames=400)
    assert share_late(shown) <= 0.005
    assert float(np.percentile([frame.age - sent(0)[-1] for frame in shown], 50)) < 0.020 + 0.025


@pytest.mark.parametrize('loss', [0.0, 0.5])
@pytest.mark.parametrize('count', [2, 3, 5])
def test_frames_of_few_datagrams(count: int, loss: float) -> None:
    shown = run(evenly(count, 0.002), loss, jitter(0.010), frames=800)
    assert share_late(shown) <= 0.005
    assert waited(shown, 50) < 0.04


def test_a_frame_of_one_datagram_does_not_wait() -> None:
    assert {frame.waited for frame in run(evenly(1, 0.01), 0.5)} == {0.0}


@pytest.mark.parametrize('loss', [0.0, 0.5, 0.9])
def test_the_pace_may_change_in_the_middle_of_a_frame_and_with_each(loss: float) -> None:
    slower = np.cumsum(np.r_[0.0, np.full(20, 0.001), np.full(20, 0.004)])
    assert share_late(run(lambda number: slower, loss, frames=300)) <= 0.005
    assert share_late(run(lambda number: evenly(30, 0.001 if number % 2 else 0.003)(number), loss, frames=300)) <= 0.005


@pytest.mark.parametrize('loss', [0.0, 0.5])
def test_turns_of_other_streams(loss: float) -> None:
    """In each frame another stream takes the link for 8 ms, somewhere."""
    random = np.random.RandomState(3)

    def sent(number: int) -> Any:
        times = evenly(40, 0.001)(number)
        return times + 0.008 * (np.arange(40) > random.randint(40))
    shown = run(sent, loss, frames=300)
    assert share_late(shown) <= 0.005 and waited(shown, 99) < 0.04


def test_where_nothing_is_lost_a_rare_pause_ends_no_frame() -> None:
    """The robot's or the operator's machine is busy for 15 ms once in 50 frames."""
    def sent(number: int) -> Any:
        return evenly(430, 1e-5)(number) + 0.015 * (number % 50 == 49) * (np.arange(430) > 200)
    assert share_late(run(sent, frames=200)) == 0.0


def test_more_jitter_is_learned_from_what_came_too_late() -> None:
    """The link is calm for 60 frames, then not any more: of the first frames after that datagrams are too late."""
    random = np.random.RandomState(4)

    def sent(number: int) -> Any:
        return np.sort(evenly(40, 0.0006)(number) + (random.uniform(0, 0.03, 40) if number >= 60 else 0.0))
    shown = run(sent, 0.5, frames=160, skip=0)
    assert sum(frame.late for frame in shown[:60]) == 0
    assert share_late(shown[60:70]) < 0.1 and share_late(shown[70:]) <= 0.005


def test_the_margin_shrinks_where_datagrams_are_lost_and_come_in_time() -> None:
    end = FrameEnd()
    margins: List[float] = []
    for number in range(60):
        end.begin()
        for place in range(0, 40, 2):
            end.add(np.array([place]), number + 0.001 * place)
        margins.append(end.margin)
    assert margins[0] == pytest.approx(FIRST_MARGIN) and margins[-1] < LEAST_MARGIN + 0.001


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 65534), st.floats(0, 0.3), st.integers(0, 3)), min_size=1, max_size=40))
def test_no_places_delay_a_frame_beyond_max_wait(forged: Any) -> None:
    """Hostile datagrams of frames with 65535, at any times; a frame in good order follows."""
    frames: FrameAssembler[Parts] = FrameAssembler(lambda head: Parts(head.count), 0.2)
    now = 100.0
    for place, pause, newer in forged:
        now += pause
        while frames.poll(now) is not None:
            pass
        frames.add(SimpleNamespace(stamp=int(1e11) + newer, count=65535), (np.array([place]),), now)
        deadline = frames.deadline()
        assert deadline is None or deadline <= now + 0.2
    frames.add(SimpleNamespace(stamp=int(1.5e11), count=10), (np.arange(5),), now + 0.5)
    deadline = frames.deadline()
    while frames.poll(now + 0.5) is not None:
        deadline = frames.deadline()
    assert deadline is None or deadline <= now + 0.5 + 0.2
