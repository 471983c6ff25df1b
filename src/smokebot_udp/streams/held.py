# SPDX-License-Identifier: BSD-3-Clause
"""What an operator holds of a stream: numbers of one session, reported to the robot as runs (msg/Held).

The robot does not repeat what all operators hold, and predicts images from those that all operators hold. What does not
fit in a report's datagram is left out, and is sent once more: a report never claims what is not held.
"""
import bisect
import math
from typing import Iterable, List, Mapping, NamedTuple, Optional, Tuple

import numpy as np

from ..arrays import BoolArray, IntArray
from ..msg import Held
from .segments import room

TOPIC = '/smokebot_udp/held'
"""Topic of the reports, on the wire."""

MAX_RUNS = 256
"""Number of runs in a report, at most."""

RUN_SIZE, LAYERS_SIZE = 6, 1
"""Size of a run in a report, and of its number of layers [byte]."""

MAX_COUNT = (1 << 16) - 1
"""Length of a run in a report, at most."""

END = 1 << 32
"""All numbers are below this."""


class Holding(NamedTuple):
    """Numbers that are held."""
    session: int
    """Session of the numbers, chosen by the sender."""
    runs: Tuple[Tuple[int, int], ...]
    """((first number, count), ...): ascending, without overlaps; empty: nothing is held."""
    layers: Tuple[int, ...] = ()
    """Layered images: how many layers are held of each image of each run, from 1 on. Other streams: empty."""

    @classmethod
    def of(cls, session: int, numbers: Iterable[int]) -> 'Holding':
        """What is reported of these numbers: all, or their MAX_RUNS longest runs.

        :param numbers: 0..END - 1, in any order
        """
        runs: List[Tuple[int, int]] = []
        for number in sorted(set(numbers)):
            first, count = runs[-1] if runs else (0, 0)
            if number == first + count and 0 < count < MAX_COUNT:
                runs[-1] = first, count + 1
            else:
                runs.append((number, 1))
        return cls(session, longest(runs))

    @classmethod
    def of_layers(cls, session: int, layers: Mapping[int, int]) -> 'Holding':
        """What is reported of images in layers: all, or the newest MAX_RUNS runs.

        :param layers: {number of the image: how many of its layers are held}, from 1 to 255
        """
        runs: List[Tuple[int, int, int]] = []
        for number, held in sorted(layers.items()):
            first, count, before = runs[-1] if runs else (0, 0, 0)
            if (number, held) == (first + count, before) and 0 < count < MAX_COUNT:
                runs[-1] = first, count + 1, held
            else:
                runs.append((number, 1, held))
        runs = runs[-MAX_RUNS:]
        return cls(session, tuple(run[:2] for run in runs), tuple(held for _, _, held in runs))

    def among(self, numbers: IntArray) -> BoolArray:
        """(n,): which of these numbers are held.

        :param numbers: (n,) int64
        """
        runs = np.array(self.runs, np.int64).reshape(-1, 2)
        at: IntArray = np.searchsorted(runs[:, 0], numbers, 'right') - 1
        held: BoolArray = at >= 0
        held[held] = numbers[held] < runs[at[held]].sum(axis=1)
        return held

    def layers_of(self, number: int) -> int:
        """How many layers of an image are held; 0: none."""
        run = self._run_of(number)
        return 0 if run is None or not self.layers else self.layers[run]

    def _run_of(self, number: int) -> Optional[int]:
        at = bisect.bisect_right(self.runs, (number, math.inf)) - 1
        return at if at >= 0 and number < sum(self.runs[at]) else None


def longest(runs: Iterable[Tuple[int, int]], most: int = MAX_RUNS) -> Tuple[Tuple[int, int], ...]:
    """The longest runs, ascending; of equal ones the latest, which were sent last."""
    return tuple(sorted(sorted(runs, key=lambda run: (run[1], run[0]), reverse=True)[:most]))


def to_message(holding: Holding, stream: str, max_datagram_size: int) -> Held:
    """The report of an operator's node about a stream, in one datagram.

    :param max_datagram_size: [byte of UDP payload]
    :raises ValueError: the name leaves no room
    """
    space, layers = room(Held, max_datagram_size, stream), holding.layers
    if layers:      # the newest images
        start = max(len(layers) - space // (RUN_SIZE + LAYERS_SIZE), 0)
        runs, layers = holding.runs[start:], layers[start:]
    else:
        runs = longest(holding.runs, space // RUN_SIZE)
    return Held(stream=stream, session=holding.session, first=[first for first, _ in runs],
                count=[count for _, count in runs], layers=bytes(layers))


def from_message(message: Held) -> Holding:
    """What a report says.

    :raises ValueError: it contradicts itself, or is longer than any that `of` makes
    """
    if len(message.first) != len(message.count):
        raise ValueError('there are %d first numbers and %d counts' % (len(message.first), len(message.count)))
    if len(message.layers) not in (0, len(message.first)) or 0 in message.layers:
        raise ValueError('there are %d runs of images of %s layers' % (len(message.first), list(message.layers)))
    if len(message.first) > MAX_RUNS:
        raise ValueError('%d runs are more than %d' % (len(message.first), MAX_RUNS))
    runs = tuple(zip(map(int, message.first), map(int, message.count)))
    end = 0
    for first, count in runs:
        if first < end or not count or first + count > END:
            raise ValueError('a run of %d numbers from %d on, after those below %d' % (count, first, end))
        end = first + count
    return Holding(int(message.session), runs, tuple(message.layers))
