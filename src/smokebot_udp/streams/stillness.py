# SPDX-License-Identifier: BSD-3-Clause
"""Whether the robot stands, from what tells it best: odometry, else its commands, else its pictures. Without clock."""

SOURCES = 'odometry', 'command', 'pictures'
"""The best first: the first that still speaks is believed, whatever those after it say."""


class Stillness:
    """The robot stands when a source has said so all the time for `hold`, and not fallen silent meanwhile.

    What is told is in order of time; numbers that are none count as movement.

    :param speed: slower is standing [m/s]
    :param turn_rate: slower is standing [rad/s]
    :param changed: while it stands at most this share of the pictures' cells changes, 0..1: people, small flames
    :param hold: [s]
    :param silence: a source that was silent for longer is not believed until it has spoken for `hold` again [s]
    """

    def __init__(self, speed=0.02, turn_rate=0.02, changed=0.05, hold=0.5, silence=1.0):
        self.speed, self.turn_rate, self.changed = speed, turn_rate, changed
        self.hold, self.silence = hold, silence
        self._latest = {}   # {source: when it spoke last [s]}
        self._since = {}    # {source: since when it says that the robot stands [s]; None: it moves}

    def odometry(self, speed, turn_rate, now):
        """Told by odometry, at a time.

        :param speed: [m/s], of either sign
        :param turn_rate: [rad/s], of either sign
        :param now: [s], of a clock that does not jump
        """
        self._told('odometry', abs(speed) < self.speed and abs(turn_rate) < self.turn_rate, now)

    def command(self, speed, turn_rate, now):
        """Told by what the robot is commanded to do: as odometry."""
        self._told('command', abs(speed) < self.speed and abs(turn_rate) < self.turn_rate, now)

    def pictures(self, changed, now):
        """Told by two pictures.

        :param changed: the share of their cells that changed, 0..1; None: they could not be compared, which says
                        nothing, see codecs.integrate.Integrated
        """
        if changed is not None:
            self._told('pictures', changed <= self.changed, now)

    def source(self, now):
        """Which of SOURCES is believed now; None: all are silent."""
        return next((source for source in SOURCES if self._speaks(source, now)), None)

    def stands(self, now):
        """Whether the robot is known to stand; where nothing tells, it is not."""
        since = self._since.get(self.source(now))
        return since is not None and now - since >= self.hold

    def _told(self, source, stands, now):
        if not stands:
            self._since[source] = None
        elif not self._speaks(source, now) or self._since[source] is None:
            self._since[source] = now
        self._latest[source] = now

    def _speaks(self, source, now):
        return source in self._latest and 0 <= now - self._latest[source] <= self.silence
