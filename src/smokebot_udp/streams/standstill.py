# SPDX-License-Identifier: BSD-3-Clause
"""Whether the robot stands still, by the best source that is heard: odometry, commands or images. Without a clock."""
from typing import Dict, Optional

SOURCES = 'odometry', 'command', 'images'
"""The best first: the first one that is heard is believed, even if later ones disagree."""

MAX_SPEED, MAX_TURN_RATE = 0.02, 0.02
"""Below these the robot stands [m/s, rad/s]."""

MAX_CHANGED = 0.05
"""Share of the images' cells that may change while it stands, 0..1: people, small flames."""

HOLD = 0.5
"""The robot stands still if a source has said so without interruption for this time [s]."""

SILENCE = 1.0
"""After a longer silence a source is believed only once it has been heard for HOLD again [s]."""


class StandstillDetector:
    """Decides by all sources. Calls are in order of time. NaN and infinite values count as motion."""

    def __init__(self) -> None:
        self._latest: Dict[str, float] = {}     # {source: when it was heard last [s]}
        self._since: Dict[Optional[str], Optional[float]] = {}  # {source: start of the standstill [s]; None: it moves}

    def velocity(self, source: str, speed: float, turn_rate: float, now: float) -> None:
        """Note measured or commanded velocities.

        :param source: odometry or command
        :param speed: [m/s], of either sign
        :param turn_rate: [rad/s], of either sign
        :param now: by a steady clock [s]
        """
        self._note(source, abs(speed) < MAX_SPEED and abs(turn_rate) < MAX_TURN_RATE, now)

    def images(self, changed: Optional[float], now: float) -> None:
        """Note the comparison of two images of one camera.

        :param changed: share of their cells that differ, 0..1; None: not comparable, which means nothing, see
            codecs.concealment.temporal
        """
        if changed is not None:
            self._note('images', changed <= MAX_CHANGED, now)

    def source(self, now: float) -> Optional[str]:
        """Which of SOURCES is believed; None: none is heard."""
        return next((source for source in SOURCES if self._is_heard(source, now)), None)

    def is_still(self, now: float) -> bool:
        """Whether the robot is known to stand still; False if no source is heard."""
        since = self._since.get(self.source(now))
        return since is not None and now - since >= HOLD

    def _note(self, source: str, still: bool, now: float) -> None:
        if not still:
            self._since[source] = None
        elif not self._is_heard(source, now) or self._since[source] is None:
            self._since[source] = now
        self._latest[source] = now

    def _is_heard(self, source: str, now: float) -> bool:
        return source in self._latest and 0 <= now - self._latest[source] <= SILENCE
