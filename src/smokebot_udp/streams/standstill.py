# SPDX-License-Identifier: BSD-3-Clause
"""Whether the robot stands still, by the best source that is heard: odometry, commands or images. Without a clock."""
from typing import Dict, Optional

SOURCES = 'odometry', 'command', 'images'
"""The best first: the first one that is heard is believed, even if later ones disagree."""


class StandstillDetector:
    """The robot stands still if a source has said so without interruption for `hold`.

    Calls are in order of time. NaN and infinite values count as motion.

    :param speed: below this the robot stands [m/s]
    :param turn_rate: below this the robot stands [rad/s]
    :param changed: share of the images' cells that may change while it stands, 0..1: people, small flames
    :param hold: [s]
    :param silence: after a longer silence a source is believed only once it has been heard for `hold` again [s]
    """

    def __init__(self, speed: float = 0.02, turn_rate: float = 0.02, changed: float = 0.05, hold: float = 0.5,
                 silence: float = 1.0) -> None:
        self.speed, self.turn_rate, self.changed = speed, turn_rate, changed
        self.hold, self.silence = hold, silence
        self._latest: Dict[str, float] = {}     # {source: when it was heard last [s]}
        self._since: Dict[Optional[str], Optional[float]] = {}  # {source: start of the standstill [s]; None: it moves}

    def odometry(self, speed: float, turn_rate: float, now: float) -> None:
        """Note measured velocities.

        :param speed: [m/s], of either sign
        :param turn_rate: [rad/s], of either sign
        :param now: by a steady clock [s]
        """
        self._note('odometry', abs(speed) < self.speed and abs(turn_rate) < self.turn_rate, now)

    def command(self, speed: float, turn_rate: float, now: float) -> None:
        """Note commanded velocities; parameters as of ``odometry``."""
        self._note('command', abs(speed) < self.speed and abs(turn_rate) < self.turn_rate, now)

    def images(self, changed: Optional[float], now: float) -> None:
        """Note the comparison of two images of one camera.

        :param changed: share of their cells that differ, 0..1; None: not comparable, which means nothing, see
            codecs.concealment.temporal
        """
        if changed is not None:
            self._note('images', changed <= self.changed, now)

    def source(self, now: float) -> Optional[str]:
        """Which of SOURCES is believed; None: none is heard."""
        return next((source for source in SOURCES if self._is_heard(source, now)), None)

    def is_still(self, now: float) -> bool:
        """Whether the robot is known to stand still; False if no source is heard."""
        since = self._since.get(self.source(now))
        return since is not None and now - since >= self.hold

    def _note(self, source: str, still: bool, now: float) -> None:
        if not still:
            self._since[source] = None
        elif not self._is_heard(source, now) or self._since[source] is None:
            self._since[source] = now
        self._latest[source] = now

    def _is_heard(self, source: str, now: float) -> bool:
        return source in self._latest and 0 <= now - self._latest[source] <= self.silence
