# SPDX-License-Identifier: BSD-3-Clause
"""The operator's side keeps commands back while they would be given blindly or in vain.

With `require_fresh` no command leaves while the operator looks at an old image, and after any lock the first command
has to be neutral: a stick that is still pushed must not move the robot when the image comes back. Without it commands
are kept back as long as the robot would refuse them. After an emergency stop the first one has to be neutral either
way: its release, which may be another operator's, must not move the robot (ISO 13850: a reset starts nothing).
"""
from typing import Optional

START_FROM_NEUTRAL = 'release the stick'
"""Reason of a lock that the next neutral command ends, with what is not neutral."""

CLOCK_UNKNOWN = "the robot's clock is not known well enough"


class Interlock:
    """Decides for one command stream whether commands leave.

    :param require_fresh: name of the image stream that has to be fresh; empty: none has
    :param max_view_age: age of its image on the screen up to which commands leave [s]
    :param has_neutral: whether there is a command that asks for nothing, so that an emergency stop locks
    """

    def __init__(self, require_fresh: str, max_view_age: float, has_neutral: bool = True) -> None:
        self.max_view_age = max_view_age
        """May be changed at any time [s]."""
        self._require_fresh, self._has_neutral = require_fresh, has_neutral
        self._locked = bool(require_fresh)
        self._deviation: Optional[str] = None   # of the last command
        self._releases: Optional[int] = None    # that are known

    @property
    def awaits_neutral(self) -> bool:
        """Whether commands are locked until a neutral one comes."""
        return self._locked

    def look(self, view_age: Optional[float], clock_known: bool, refusal: str,
             releases: Optional[int] = None) -> Optional[str]:
        """Why commands are locked now; None: they are not. To be called also while there are no commands.

        :param view_age: of the image on the screen [s]; None: there is none
        :param clock_known: whether the robot's clock is known so well that the robot may take a command
        :param refusal: why the robot does not take commands; empty: it does
        :param releases: how often the emergency stop was released; None: unknown
        """
        return self._obstacle(view_age, clock_known, refusal, releases) or self._not_neutral()

    def may_send(self, deviation: Optional[str], view_age: Optional[float], clock_known: bool, refusal: str,
                 releases: Optional[int] = None) -> Optional[str]:
        """Why a command is not sent; None: it is.

        :param deviation: what of it is not neutral; None: it asks for nothing
        """
        self._deviation = deviation
        obstacle = self._obstacle(view_age, clock_known, refusal, releases)
        if obstacle is None and deviation is None:
            self._locked = False
        return obstacle or self._not_neutral()

    def _obstacle(self, view_age: Optional[float], clock_known: bool, refusal: str,
                  releases: Optional[int]) -> Optional[str]:
        """Why not even a neutral command would leave now."""
        reason = self._blind(view_age) or (None if clock_known else CLOCK_UNKNOWN) or refusal or None
        released = self._has_neutral and None not in (releases, self._releases) and releases != self._releases
        if released or (reason is not None and self._require_fresh):
            self._locked = True
        self._releases = self._releases if releases is None else releases
        return reason

    def _not_neutral(self) -> Optional[str]:
        if not self._locked:
            return None
        return START_FROM_NEUTRAL + ('' if self._deviation is None else ': %s is not at rest' % self._deviation)

    def _blind(self, view_age: Optional[float]) -> Optional[str]:
        if not self._require_fresh:
            return None
        if view_age is None:
            return 'no image of %s' % self._require_fresh
        if not abs(view_age) <= self.max_view_age:      # an image of the future or NaN: a clock is wrong
            return '%s is %.1f s old' % (self._require_fresh, view_age)
        return None
