# SPDX-License-Identifier: BSD-3-Clause
"""Which of the operator's streams show old data, and the text that warns of them."""
from dataclasses import dataclass
from typing import Dict, Mapping, Optional, Tuple

MISSED_PERIODS = 3.0
"""A slow stream is stale after this many missed messages."""


@dataclass(frozen=True)
class Freshness:
    """When a stream was last shown, and whether it should be."""
    last_shown: Optional[float]
    """By a monotonic clock [s]; None: never."""
    steady: bool = True
    """False for a stream that may be silent without a fault: a latched topic, a carousel."""
    enabled: bool = True
    """Whether the robot sends it."""
    rate: float = 0.0
    """Its maximum rate [Hz]; 0: unknown."""
    interval: float = 0.0
    """From one message to the next, lately [s]; 0: unknown. A source may be slower than the maximum rate."""

    def limit(self, after: float) -> float:
        """The silence that makes it stale, `after` at least [s]."""
        return max(after, MISSED_PERIODS / self.rate if self.rate else 0.0, MISSED_PERIODS * self.interval)


def stale_streams(streams: Mapping[str, Freshness], after: float, now: float) -> Tuple[Dict[str, float], int]:
    """Find the streams that show old data.

    Streams that are not steady, not sent by the robot, or have never been shown are not stale.

    :param streams: by name
    :param after: shortest silence that makes a stream stale [s]
    :param now: by the monotonic clock of `last_shown` [s]
    :return: ({name: length of its silence [s]}, number of streams that could be stale)
    """
    watched = {name: (now - stream.last_shown, stream.limit(after))
               for name, stream in streams.items()
               if stream.steady and stream.enabled and stream.last_shown is not None}
    return {name: silence for name, (silence, limit) in watched.items() if silence > limit}, len(watched)


def outdated_streams(streams: Mapping[str, Freshness], after: float, now: float) -> Dict[str, float]:
    """The streams whose last message is no longer true: stale ones, and those that the robot no longer sends.

    :param streams, after, now: as of `stale_streams`
    :return: {name: when it was shown last [s]}
    """
    stale, _ = stale_streams(streams, after, now)
    return {name: stream.last_shown for name, stream in streams.items()
            if stream.last_shown is not None and (name in stale or stream.steady and not stream.enabled)}


def stale_text(silences: Mapping[str, float], watched: int) -> str:
    """The warning for a result of `stale_streams`, one short line; empty if no stream is stale."""
    if not silences:
        return ''
    first, *others = silences
    names = '' if len(silences) == watched else ': ' + first + (' +%d' % len(others) if others else '')
    return 'NO DATA %.0f s%s' % (max(silences.values()), names)
