# SPDX-License-Identifier: BSD-3-Clause
"""The messages of the settings across the link, msg/SettingsRequest and msg/SettingsState, and their channels."""
import math
from typing import Any, Dict, Mapping

from dynamic_reconfigure.encoding import decode_config, encode_config

from ..mission.remote import PartState, Request
from ..msg import SettingsRequest, SettingsState
from ..reliable.bounds import Bounds
from ..serialised import deserialised, serialised
from ..streams.relay.parameters import TO_OPERATOR, TO_ROBOT
from .channel import ChannelKind

REQUESTS = ChannelKind('settings', TO_ROBOT, SettingsRequest._type, SettingsRequest._md5sum, expedited=True)
STATES = ChannelKind('settings', TO_OPERATOR, SettingsState._type, SettingsState._md5sum,
                     bounds=Bounds(age=math.inf))     # none may be missing: they wait for the end of a cut

MAX_VALUES = 256
"""In a message."""

MAX_PROFILES, MAX_NAME = 64, 100
"""Profiles of a robot, and characters of a profile's name."""


def request_data(request: Request) -> bytes:
    """The serialised SettingsRequest of a Request."""
    return serialised(SettingsRequest(id=request.id, part=request.part, config=encode_config(request.values)))


def request_of(data: bytes) -> Request:
    """The Request of a serialised SettingsRequest.

    :raises ValueError: where it is impossible
    """
    message = deserialised(SettingsRequest, data)
    return Request(message.id, message.part, _values(message.config))


def state_data(state: PartState) -> bytes:
    """The serialised SettingsState of a PartState."""
    return serialised(SettingsState(
        part=state.part, request=state.request, refusal=state.refusal, changes=state.changes,
        profiles=list(state.profiles), config=encode_config(state.values)))


def state_of(data: bytes) -> PartState:
    """The PartState of a serialised SettingsState.

    :raises ValueError: where it is impossible
    """
    message = deserialised(SettingsState, data)
    if len(message.profiles) > MAX_PROFILES or any(len(name) > MAX_NAME for name in message.profiles):
        raise ValueError('more than %d profiles, or a name of more than %d characters' % (MAX_PROFILES, MAX_NAME))
    return PartState(message.part, _values(message.config), tuple(message.profiles), message.request, message.refusal,
                     message.changes)


def _values(config: Mapping[str, Any]) -> Dict[str, Any]:
    """:raises ValueError: where there are too many"""
    values = dict(decode_config(config))
    if len(values) > MAX_VALUES:
        raise ValueError('more than %d settings' % MAX_VALUES)
    return values
