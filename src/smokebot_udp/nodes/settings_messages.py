# SPDX-License-Identifier: BSD-3-Clause
"""The messages of the settings across the link, msg/SettingsRequest and msg/SettingsState, and their topics."""
from typing import Any, Dict, Mapping

from dynamic_reconfigure.encoding import decode_config, encode_config

from ..mission.remote import PartState, Request
from ..msg import SettingsRequest, SettingsState

REQUESTS, STATES = '/smokebot_udp/settings/request', '/smokebot_udp/settings/state'
"""Wire topics."""

MAX_VALUES = 256
"""In a message."""

MAX_PROFILES, MAX_NAME = 64, 100
"""Profiles of a robot, and characters of a profile's name."""


def request_message(request: Request) -> Any:
    """The SettingsRequest of a Request."""
    return SettingsRequest(id=request.id, part=request.part, config=encode_config(request.values))


def request_of(message: Any) -> Request:
    """The Request of a SettingsRequest.

    :raises ValueError: where it is impossible
    """
    return Request(message.id, message.part, _values(message.config))


def state_message(state: PartState) -> Any:
    """The SettingsState of a PartState."""
    return SettingsState(session=state.session, revision=state.revision, part=state.part, request=state.request,
                         refusal=state.refusal, changes=state.changes, profiles=list(state.profiles),
                         config=encode_config(state.values))


def state_of(message: Any) -> PartState:
    """The PartState of a SettingsState.

    :raises ValueError: where it is impossible
    """
    if len(message.profiles) > MAX_PROFILES or any(len(name) > MAX_NAME for name in message.profiles):
        raise ValueError('more than %d profiles, or a name of more than %d characters' % (MAX_PROFILES, MAX_NAME))
    return PartState(message.session, message.revision, message.part, _values(message.config),
                     tuple(message.profiles), message.request, message.refusal, message.changes)


def _values(config: Mapping[str, Any]) -> Dict[str, Any]:
    """:raises ValueError: where there are too many"""
    values = dict(decode_config(config))
    if len(values) > MAX_VALUES:
        raise ValueError('more than %d settings' % MAX_VALUES)
    return values
