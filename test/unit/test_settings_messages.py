# SPDX-License-Identifier: BSD-3-Clause
"""The messages of the settings across the link, and how much of it they take."""
import pathlib

import pytest
from dynamic_reconfigure.msg import BoolParameter, DoubleParameter, IntParameter, StrParameter

from smokebot_udp.mission.control import MissionControl
from smokebot_udp.mission.remote import PartState, Request
from smokebot_udp.mission.settings import SettingsStore
from smokebot_udp.mission.settings_server import SettingsServer
from smokebot_udp.msg import SettingsRequest, SettingsState
from smokebot_udp.nodes.settings_messages import (
    MAX_NAME,
    MAX_PROFILES,
    MAX_VALUES,
    request_data,
    request_of,
    state_data,
    state_of,
)
from smokebot_udp.serialised import deserialised, serialised
from smokebot_udp.streams import config, live_tables

CONFIG = pathlib.Path(__file__).resolve().parents[2] / 'config' / 'streams.yaml'
HEADERS = 28 + 32 + 8 + 60
"""Size of the headers of IP and UDP, of a sealed link, of UDPROS and of a ReliableSegment [byte]."""


def test_a_request_crosses_with_the_types_of_its_values() -> None:
    request = Request(7, 'thermal', {'rate': 5.0, 'scale': 2, 'enabled': False, 'coding': 'auto'})
    message = deserialised(SettingsRequest, request_data(request))
    assert (message.config.doubles, message.config.ints) == ([DoubleParameter('rate', 5.0)], [IntParameter('scale', 2)])
    assert (message.config.bools, message.config.strs) == (
        [BoolParameter('enabled', False)], [StrParameter('coding', 'auto')])
    found = request_of(request_data(request))
    assert found == request and type(found.values['enabled']) is bool and type(found.values['rate']) is float


def test_a_state_crosses() -> None:
    state = PartState('', {'focus': 'drive'}, ('default', 'drive'), 3, "focus is 'x', must be one of ...",
                      'map off')
    assert state_of(state_data(state)) == state


def test_impossible_messages_are_refused() -> None:
    message = SettingsRequest(part='thermal')
    message.config.doubles = [DoubleParameter(str(number), 0.0) for number in range(MAX_VALUES + 1)]
    with pytest.raises(ValueError, match='more than 256 settings'):
        request_of(serialised(message))
    for profiles in (['x'] * (MAX_PROFILES + 1), ['x' * (MAX_NAME + 1)]):
        with pytest.raises(ValueError, match='more than 64 profiles, or a name of more than 100 characters'):
            state_of(serialised(SettingsState(profiles=profiles)))
    for read in (request_of, state_of):
        with pytest.raises(ValueError, match='what came is no smokebot_udp/Settings'):
            read(b'no message')


def test_the_default_streams_take_few_datagrams_when_an_operator_joins() -> None:
    streams, problems = config.load(CONFIG.read_text())
    assert not problems
    stores = {name: SettingsStore(live_tables(settings).robot, settings)
              for name, settings in streams.items()}
    control = MissionControl(stores, {}, problems.append, lambda _: None, lambda: None)
    sizes = [len(state_data(state)) for state in SettingsServer(control.profiles).update(control.parts())]
    assert len(sizes) > len(streams) / 2 and max(sizes) <= 1472 - HEADERS and sum(sizes) < 8000
