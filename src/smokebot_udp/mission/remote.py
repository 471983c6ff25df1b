# SPDX-License-Identifier: BSD-3-Clause
"""The robot's settings across the link: what operators request, and what the robot answers.

A part is a stream of streams.yaml, or the mission focus. Requests and states cross on two reliable channels, in order.
The robot sends the states of all parts to an operator that joins, that of a part which changes, and an answer to each
request.
"""
from dataclasses import dataclass
from typing import Any, Mapping, Tuple

FOCUS_PART = ''
"""Name of the part that has the mission focus as its only setting."""

FOCUS_SETTING = 'focus'

MAX_TEXT = 1000
"""Maximum length of an answer; a longer one is cut [character]."""


@dataclass(frozen=True)
class Request:
    """An operator's request to change settings of a part."""
    id: int
    """Number of the request, other than 0; the same where it is sent again after a new session has begun."""
    part: str
    values: Mapping[str, Any]
    """{setting: requested value}"""


@dataclass(frozen=True)
class PartState:
    """A part at one moment."""
    part: str
    values: Mapping[str, Any]
    """{setting: requested value} of all settings that may change."""
    profiles: Tuple[str, ...] = ()
    """The names of the profiles, with FOCUS_PART."""
    request: int = 0
    """Id of the request that it answers; 0: none."""
    refusal: str = ''
    """Why that request was refused; empty: it was not."""
    changes: str = ''
    """What a switch of the focus has changed, in words."""
