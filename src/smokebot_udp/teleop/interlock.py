# SPDX-License-Identifier: BSD-3-Clause
"""The operator's side keeps commands back while they would be given blindly or in vain.

With `require_fresh` no command leaves while the operator looks at an old image, and after any lock the first command
has to be zero: a stick that is still pushed must not move the robot when the image comes back. Without it commands are
kept back as long as the robot would refuse them, and no longer.
"""
from typing import Optional

START_FROM_ZERO = 'start from zero'
"""Reason of a lock that the next zero command ends."""

CLOCK_UNKNOWN = "the robot's clock is not known well enough"


class Interlock:
    """Decides for one command stream whether commands leave.

    :param require_fresh: name of the image stream that has to be fresh; empty: none has
    :param max_view_age: age of its image on the screen up to which commands leave [s]
    """

    def __init__(self, require_fresh: str, max_view_age: float) -> None:
        self.max_view_age = max_view_age
        """May be changed at any time [s]."""
        self._require_fresh = require_fresh
        self._locked = bool(require_fresh)

    def look(self, view_age: Optional[float], clock_known: bool, refusal: str) -> Optional[str]:
        """Why commands are locked now; None: they are not. To be called also while there are no commands.

        :param view_age: of the image on the screen [s]; None: there is none
        :param clock_known: whether the robot's clock is known so well that the robot may take a command
        :param refusal: why the robot does not take commands; empty: it does
        """
        reason = self._blind(view_age) or (None if clock_known else CLOCK_UNKNOWN) or refusal or None
        if reason is not None:
            self._locked = bool(self._require_fresh)
        return reason or (START_FROM_ZERO if self._locked else None)

    def may_send(self, zero: bool, view_age: Optional[float], clock_known: bool, refusal: str) -> Optional[str]:
        """Why a command is not sent; None: it is.

        :param zero: whether it is the type's zero value, apart from a header
        """
        reason = self.look(view_age, clock_known, refusal)
        if reason == START_FROM_ZERO and zero:
            self._locked = False
            return None
        return reason

    def _blind(self, view_age: Optional[float]) -> Optional[str]:
        if not self._require_fresh:
            return None
        if view_age is None:
            return 'no image of %s' % self._require_fresh
        if not abs(view_age) <= self.max_view_age:      # an image of the future or NaN: a clock is wrong
            return '%s is %.1f s old' % (self._require_fresh, view_age)
        return None
