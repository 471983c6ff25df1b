# SPDX-License-Identifier: BSD-3-Clause
"""The messages of the settings across the link, and how much of it they take."""
import io
import pathlib
from typing import Any

import pytest
from dynamic_reconfigure.msg import BoolParameter, DoubleParameter, IntParameter, StrParameter

from smokebot_udp.mission.control import MissionControl
from smokebot_udp.mission.remote import PartState, Request
from smokebot_udp.mission.settings import SettingsStore
from smokebot_udp.mission.settings_server import LAST_REPEAT, SettingsServer
from smokebot_udp.msg import SettingsRequest, SettingsState
from smokebot_udp.nodes.settings_messages import (
    MAX_NAME,
    MAX_PROFILES,
    MAX_VALUES,
    request_message,
    request_of,
    state_message,
    state_of,
)
from smokebot_udp.streams import config, live_tables

CONFIG = pathlib.Path(__file__).resolve().parents[2] / 'config' / 'streams.yaml'
HEADERS = 28 + 32 + 8
"""Size of the headers of IP and UDP, of a sealed link, and of UDPROS [byte]."""


def crossed(message: Any) -> Any:
    """The message as it arrives."""
    buffer = io.BytesIO()
    message.serialize(buffer)
    return type(message)().deserialize(buffer.getvalue())


def test_a_request_crosses_with_the_types_of_its_values() -> None:
    request = Request(7, 'thermal', {'rate': 5.0, 'scale': 2, 'enabled': False, 'coding': 'auto'})
    message = request_message(request)
    assert (message.config.doubles, message.config.ints) == ([DoubleParameter('rate', 5.0)], [IntParameter('scale', 2)])
    assert (message.config.bools, message.config.strs) == (
        [BoolParameter('enabled', False)], [StrParameter('coding', 'auto')])
    found = request_of(crossed(message))
    assert found == request and type(found.values['enabled']) is bool and type(found.values['rate']) is float


def test_a_state_crosses() -> None:
    state = PartState(1, 2, '', {'focus': 'drive'}, ('default', 'drive'), 3, "focus is 'x', must be one of ...",
                      'map off')
    assert state_of(crossed(state_message(state))) == state


def test_impossible_messages_are_refused() -> None:
    message = SettingsRequest(part='thermal')
    message.config.doubles = [DoubleParameter(str(number), 0.0) for number in range(MAX_VALUES + 1)]
    with pytest.raises(ValueError, match='more than 256 settings'):
        request_of(message)
    for profiles in (['x'] * (MAX_PROFILES + 1), ['x' * (MAX_NAME + 1)]):
        with pytest.raises(ValueError, match='more than 64 profiles, or a name of more than 100 characters'):
            state_of(SettingsState(profiles=profiles))


def test_the_default_streams_take_less_than_1_kbit_per_second() -> None:
    streams, problems = config.load(CONFIG.read_text())
    assert not problems
    stores = {name: SettingsStore(live_tables(settings).robot, settings)
              for name, settings in streams.items()}
    control = MissionControl(stores, {}, problems.append, lambda _: None, lambda: None)
    server, now = SettingsServer(2 ** 32 - 1, control.profiles), 0.0
    server.update(control.parts())
    sizes = []
    while now < 130.0 + 2 * LAST_REPEAT:
        state = server.poll(now)
        assert state is not None
        buffer = io.BytesIO()
        state_message(state).serialize(buffer)
        sizes += [len(buffer.getvalue()) + 4 + HEADERS] if now >= 130.0 else []
        now = server.deadline() or pytest.fail('nothing is sent')
    assert max(sizes) <= 1472 and 8 * sum(sizes) / (2 * LAST_REPEAT) < 1e3
