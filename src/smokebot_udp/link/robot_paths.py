# SPDX-License-Identifier: BSD-3-Clause
"""The paths to a robot that has several addresses: which of them answer, and which one is used.

* Each path is asked by PATH_CHALLENGEs, whose answers come back to this side's address on that path. An answer proves
  both directions. Such probes carry nothing, and move no peer (RFC 9000, 9.1).
* The path in use is left where nothing came for SILENCE, or no probe was answered for UNANSWERED: data still come, but
  commands may not arrive. Both are longer on a path that pauses (pauses.py). The next one is the first, in order of
  preference, that has answered since the doubt began.
* It is in doubt from two thirds of the first time, and half of the second one. Then all paths are asked PROBE apart,
  and the one that is left as long as it may have paused.
* A preferred path is used again where it has answered three of four of its last MEMORY probes, all sent since it was
  left: one that loses more than 13 % each way seldom does. It is used again at once where it is heard before its
  silence counts as cut: that was a pause.
"""
import collections
import math
from typing import Deque, List, Optional, Sequence, Tuple

from ..pauses import Pauses
from .place import Place

MAX_PATHS = 4
"""Addresses of one robot, and of one operator that are remembered."""

PROBE, USED_PROBE, IDLE_PROBE = 0.05, 0.1, 0.25
"""Between two probes of one path: where the used one is in doubt, of those that carry something, of the others. A
probe and its answer have 76 bytes each with their headers: 6 and 2.4 kbit/s each way [s]."""

SILENCE, MAX_SILENCE = 0.15, 0.5
"""A robot sends something each 0.1 s, and most send more [s]."""

DOUBT = 2 / 3
"""The part of the silence after which a path is in doubt."""

UNANSWERED, MAX_UNANSWERED = 0.5, 2.0
"""At 20 % loss each way, 9 probes in 0.5 s are all lost once in 10 000 times [s]."""

MEMORY, STEADY = 12, 9
"""The last probes of a path, those of 3 s, and how many of them are answered where it is steady."""

ALIVE = 1.0
"""A path whose other end was heard this lately is worth a copy: nothing else is lost where it is not [s]."""

SHARED_FOR = 1.0
"""How long a path counts as shared after something came [s]."""

STAY = 1.0
"""Before a preferred path is used again the present one is used for this long: two may become steady at once [s]."""

MAX_PROBES = 40
"""Probes of a path that may be answered: those of 2 s where the used path is in doubt."""


class Probe:
    """A challenge that was sent.

    :param sent: [s]
    """

    def __init__(self, challenge: bytes, sent: float) -> None:
        self.challenge, self.sent = challenge, sent
        self.answered = False


class Path:
    """One address of the robot.

    :param now: [s]
    """

    def __init__(self, place: Place, now: float) -> None:
        self.place = place
        self.pauses = Pauses(SILENCE, MAX_SILENCE, -math.inf)
        """Times without anything from it while it is used."""
        self.unanswered = Pauses(UNANSWERED, MAX_UNANSWERED, now)
        """Times without an answer to a probe. It counts as heard when it becomes known."""
        self.round_trip: Optional[float] = None
        """Round-trip time of the latest probe that was answered [s]."""
        self.shared = -math.inf
        """When something came that the robot sends beside the path that is used [s]."""
        self.probed = -math.inf
        """When it was asked [s]."""
        self._left = -math.inf      # when another path was used in its place
        self._probes: Deque[Probe] = collections.deque(maxlen=MAX_PROBES)

    @property
    def answered(self) -> float:
        """When a probe was answered, or the path became known [s]."""
        return self.unanswered.heard

    def ask(self, challenge: bytes, now: float) -> None:
        """A challenge was sent."""
        self._probes.append(Probe(challenge, now))
        self.probed = now

    def take(self, response: bytes, now: float) -> bool:
        """Whether a response answers a probe of this path."""
        for probe in self._probes:
            if probe.challenge == response and not probe.answered:
                probe.answered = True
                self.unanswered.hear(now, now)
                self.round_trip = now - probe.sent
                return True
        return False

    def is_shared(self, now: float) -> bool:
        """Whether the robot sends a part by this path, beside the one that is used."""
        return now - self.shared < SHARED_FOR

    def is_steady(self) -> bool:
        """Whether STEADY of the last MEMORY probes were answered, all of them sent since the path was left."""
        last = [probe for probe in list(self._probes)[-MEMORY:] if probe.sent >= self._left]
        return len(last) == MEMORY and sum(probe.answered for probe in last) >= STEADY

    def leave(self, now: float) -> None:
        """Another path is used in its place: what it did before says nothing [s]."""
        self._left = now

    def has_paused(self) -> bool:
        """Whether it was left in what has shown to be a pause."""
        return self.answered > self._left and self.answered - self.pauses.heard <= MAX_SILENCE


class RobotPaths:
    """The paths to one robot.

    :param places: the robot's addresses, in order of preference
    :param used: one of them, over which the robot has just answered
    :param now: [s]
    """

    def __init__(self, places: Sequence[Place], used: Place, now: float) -> None:
        self.paths = [Path(place, now) for place in places]
        self._used = next(path for path in self.paths if path.place == used)
        self._chosen = now      # when the used path was
        self._used.pauses.hear(now, now)

    @property
    def used(self) -> Place:
        """The address to which everything but probes and copies goes."""
        return self._used.place

    def second(self, now: float) -> Optional[Place]:
        """The first other address that answers; None: none does [s]."""
        return next((path.place for path in self.paths if path is not self._used and now - path.answered < ALIVE), None)

    def carried(self, now: float) -> None:
        """Something other than probes and copies came by the used path."""
        self._used.pauses.hear(now, now)

    def shared(self, source: Place, now: float) -> None:
        """Something came that the robot sends by another path, whose address is known if the robot is not behind a
        NAT."""
        others = [path for path in self.paths if path is not self._used]
        path = next((path for path in others if path.place.covers(source)), others[0])
        path.shared = now

    def _unanswered_since(self) -> float:
        """Since when no probe of the used path is answered [s]."""
        return max(self._used.answered, self._chosen)

    def _doubts(self, now: float) -> List[Tuple[float, float]]:
        """The moments from when the used path is in doubt, and when it is left: if nothing comes, and if no probe is
        answered [s]."""
        silence, unanswered = self._used.pauses.limit(now), self._used.unanswered.limit(now)
        since, asked = self._used.pauses.heard, self._unanswered_since()
        return [(since + DOUBT * silence, since + silence), (asked + unanswered / 2, asked + unanswered)]

    def _is_doubtful(self, now: float) -> bool:
        return any(now >= begins for begins, _ in self._doubts(now))

    def _period(self, path: Path, now: float) -> float:
        may_pause = path is not self._used and now - path.pauses.heard <= MAX_SILENCE
        if may_pause or self._is_doubtful(now):
            return PROBE
        return USED_PROBE if path is self._used or path.is_shared(now) else IDLE_PROBE

    def due(self, now: float) -> List[Path]:
        """The paths that are to be asked now."""
        return [path for path in self.paths if now >= path.probed + self._period(path, now)]

    def deadline(self, now: float) -> float:
        """When to call `due` and `choose` next, at the latest [s]."""
        return min([path.probed + self._period(path, now) for path in self.paths]
                   + [time for time in self._doubts(now)[0] if time > now])

    def take(self, response: bytes, now: float) -> bool:
        """Whether a response answers a probe."""
        answered = next((path for path in self.paths if path.take(response, now)), None)
        if answered is self._used:
            self.carried(now)
        return answered is not None

    def choose(self, now: float) -> bool:
        """Use another path where that is due; returns whether it is."""
        path = self._better(now)
        if path is None:
            return False
        self._used.leave(now)
        self._used, self._chosen = path, now
        path.pauses.hear(now, now)
        return True

    def _better(self, now: float) -> Optional[Path]:
        before = self.paths[:self.paths.index(self._used)]
        paused = next((path for path in before if path.has_paused()), None)
        if paused is not None:
            return paused
        steady = next((path for path in before if path.is_steady() and now - path.answered < 2 * IDLE_PROBE), None)
        if steady is not None and now - self._chosen >= STAY:
            return steady
        doubt = next((begins for begins, ends in self._doubts(now) if now >= ends), math.inf)
        return next((path for path in self.paths if path is not self._used and path.answered >= doubt), None)
