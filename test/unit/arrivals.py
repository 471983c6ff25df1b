# SPDX-License-Identifier: BSD-3-Clause
"""Frames of datagrams that arrive as a link lets them, for tests of when a frame is finished; no network, no clock."""
from types import SimpleNamespace
from typing import Callable, Iterator, List, NamedTuple, Sequence, Tuple

import numpy as np

from smokebot_udp.codecs.wire.parts import ReceivedParts
from smokebot_udp.streams.frame_assembler import FrameAssembler

Sent = Callable[[int], Sequence[float]]
"""f(number of the frame) -> when each of its datagrams leaves, after the first one [s]"""

Delay = Callable[[np.random.RandomState, int], Sequence[float]]
"""f(random, n) -> how long each of n datagrams takes [s]"""


class Parts(ReceivedParts):
    """A frame whose datagrams are nothing but their numbers."""

    def add(self, numbers: 'np.ndarray') -> 'np.ndarray':
        self.have[numbers] = True
        return np.ones(len(numbers), bool)


class Shown(NamedTuple):
    """What became of a frame."""
    count: int
    """Datagrams that were sent of it."""
    waited: float
    """From when the last datagram that arrived did, until the frame was finished; negative: it did not wait [s]."""
    age: float
    """When it was finished, after its first datagram left [s]."""
    late: int
    """Datagrams that arrived when it was finished."""


def evenly(count: int, pace: float) -> Sent:
    """Frames of `count` datagrams, one every `pace` seconds."""
    return lambda number: pace * np.arange(count)


def at_once(random: np.random.RandomState, count: int) -> 'np.ndarray':
    """A delay of zero."""
    return np.zeros(count)


def jitter(most: float) -> Delay:
    """Delays of 0 to 2 `most`, each datagram's by itself: they overtake each other [s]."""
    return lambda random, count: random.uniform(0, 2 * most, count)


def run(sent: Sent, loss: float = 0.0, delay: Delay = at_once, frames: int = 60, period: float = 0.5,
        max_wait: float = 0.2, skip: int = 20, seed: int = 1, batch: float = 0.0) -> List[Shown]:
    """What becomes of frames that leave one after the other; those without any datagram are left out.

    :param skip: the first frames, which are not returned
    :param batch: datagrams are taken together that arrive within this time [s]
    """
    random = np.random.RandomState(seed)
    assembler = FrameAssembler(lambda head: Parts(head.count), max_wait)
    shown = []
    for number in range(frames):
        times = np.asarray(sent(number))
        arrivals = times + delay(random, len(times))
        came = np.flatnonzero(random.random_sample(len(times)) >= loss)
        if not len(came):
            continue
        begun = number * period
        head = SimpleNamespace(stamp=10 ** 9 + int(begun * 1e9), count=len(times))
        finished, late = _receive(assembler, head, sorted((arrivals[i], int(i)) for i in came), begun, batch)
        shown.append(Shown(len(times), finished - begun - float(arrivals[came].max()), finished - begun, late))
    return shown[skip:]


def _receive(assembler: 'FrameAssembler[Parts]', head: SimpleNamespace, arrivals: List[Tuple[float, int]], begun: float,
             batch: float) -> Tuple[float, int]:
    """(when the frame was finished, how many datagrams came later)"""
    finished, late = None, 0
    for now, places in _batches(arrivals, batch):
        finished = _finished(assembler, begun + now) if finished is None else finished
        if finished is not None:
            late += len(places)
        assembler.add(head, (np.array(places),), begun + now)
        if finished is None and assembler.poll(begun + now) is not None:
            finished = begun + now
    if finished is None:
        finished = _finished(assembler, np.inf)
    assert finished is not None
    return finished, late


def _finished(assembler: 'FrameAssembler[Parts]', now: float) -> 'float | None':
    """When the frame was finished before now; None: it is not."""
    deadline = assembler.deadline()
    if deadline is None or deadline >= now:
        return None
    assert assembler.poll(deadline) is not None
    return deadline


def _batches(arrivals: List[Tuple[float, int]], batch: float) -> Iterator[Tuple[float, List[int]]]:
    while arrivals:
        now = arrivals[0][0] + batch
        yield now, [place for when, place in arrivals if when <= now]
        arrivals = [arrival for arrival in arrivals if arrival[0] > now]


def share_late(shown: Sequence[Shown]) -> float:
    """The share of the datagrams sent that were lost because their frame was finished early."""
    return sum(frame.late for frame in shown) / sum(frame.count for frame in shown)
