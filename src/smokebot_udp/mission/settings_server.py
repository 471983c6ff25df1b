# SPDX-License-Identifier: BSD-3-Clause
"""The robot's half of the settings across the link: which states operators lack, and which requests are carried out."""
from typing import Any, Dict, List, Mapping, Sequence

from ..budget import Budget
from .remote import FOCUS_PART, MAX_TEXT, PartState, Request

BURST, REQUEST_PERIOD = 20, 0.1
"""Number of requests that are carried out at once, and the time to one more [s]. Others are refused."""


class SettingsServer:
    """Decides for one robot.

    :param profiles: the names of the profiles of the mission focus
    """

    def __init__(self, profiles: Sequence[str]) -> None:
        self._profiles = tuple(profiles)
        self._parts: Dict[str, Mapping[str, Any]] = {}
        self._budget = Budget(BURST, REQUEST_PERIOD)

    def update(self, parts: Mapping[str, Mapping[str, Any]]) -> List[PartState]:
        """Take over the present values; the states of the parts that differ.

        :param parts: {part: {setting: requested value}}
        """
        changed = [name for name, values in parts.items() if self._parts.get(name) != values]
        self._parts.update((name, dict(parts[name])) for name in changed)
        return [self._state(name) for name in changed]

    def states(self) -> List[PartState]:
        """The states of all parts, for an operator that joins."""
        return [self._state(name) for name in self._parts]

    def check(self, request: Request, now: float) -> None:
        """Check whether a request may be carried out.

        :param now: by a steady clock [s]
        :raises ValueError: where it may not
        """
        if not self._budget.take(now):
            raise ValueError('too many requests for settings')
        if request.part not in self._parts:
            raise ValueError('there are no settings of %r' % request.part)

    def answer(self, request: Request, refusal: str, changes: str = '') -> PartState:
        """The answer to a request that has been carried out, after an `update`; or that was refused.

        :param refusal: why; empty: it was not
        :param changes: what it has changed, in words
        """
        return self._state(request.part, request.id, refusal[:MAX_TEXT], changes[:MAX_TEXT])

    def _state(self, name: str, request: int = 0, refusal: str = '', changes: str = '') -> PartState:
        profiles = self._profiles if name == FOCUS_PART else ()
        return PartState(name, self._parts.get(name, {}), profiles, request, refusal, changes)
