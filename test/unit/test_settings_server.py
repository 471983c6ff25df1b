# SPDX-License-Identifier: BSD-3-Clause
from typing import Any, Dict

import pytest

from smokebot_udp.mission.remote import MAX_TEXT, PartState, Request
from smokebot_udp.mission.settings_server import BURST, REQUEST_PERIOD, SettingsServer

PARTS: Dict[str, Dict[str, Any]] = {'': {'focus': 'default'}, 'thermal': {'rate': 10.0}, 'map': {'rate': 1.0}}
PROFILES = 'default', 'drive'
STATES = [PartState('', {'focus': 'default'}, PROFILES), PartState('thermal', {'rate': 10.0}),
          PartState('map', {'rate': 1.0})]


@pytest.fixture
def server() -> SettingsServer:
    made = SettingsServer(PROFILES)
    assert made.states() == []
    assert made.update(PARTS) == STATES
    return made


def test_who_joins_gets_all_parts_and_then_what_changes(server: SettingsServer) -> None:
    assert server.states() == STATES
    assert server.update(PARTS) == []
    changed = [PartState('map', {'rate': 2.0})]
    assert server.update({**PARTS, 'map': {'rate': 2.0}}) == changed
    assert server.states() == STATES[:2] + changed


def test_a_state_keeps_the_values_of_its_time(server: SettingsServer) -> None:
    before, values = server.states()[1], {'rate': 3.0}
    changed, = server.update({'thermal': values})
    values['rate'] = 4.0
    assert before.values == {'rate': 10.0} and changed.values == {'rate': 3.0}


def test_an_answer_has_the_values_after_the_request(server: SettingsServer) -> None:
    request = Request(5, 'thermal', {'rate': 3.0})
    server.check(request, 10.0)
    server.update({**PARTS, 'thermal': {'rate': 3.0}})
    assert server.answer(request, '') == PartState('thermal', {'rate': 3.0}, (), 5)
    focus = Request(6, '', {'focus': 'default'})
    assert server.answer(focus, '', 'map off') == PartState('', {'focus': 'default'}, PROFILES, 6, '', 'map off')
    answer = server.answer(focus, 'r' * (MAX_TEXT + 1), 'c' * (MAX_TEXT + 1))
    assert (answer.refusal, answer.changes) == ('r' * MAX_TEXT, 'c' * MAX_TEXT)


def test_what_does_not_exist_is_refused_and_answered(server: SettingsServer) -> None:
    request = Request(9, 'lidar', {})
    with pytest.raises(ValueError, match="there are no settings of 'lidar'"):
        server.check(request, 0.0)
    assert server.answer(request, 'no') == PartState('lidar', {}, (), 9, 'no')


def served(server: SettingsServer, count: int, now: float) -> int:
    """How many of some requests may be carried out."""
    good = 0
    for number in range(count):
        try:
            server.check(Request(number + 1, 'map', {}), now)
            good += 1
        except ValueError as error:
            assert str(error) == 'too many requests for settings'
    return good


def test_a_flood_is_limited(server: SettingsServer) -> None:
    assert served(server, 1000, 10.0) == BURST
    assert served(server, 1000, 11.0) == round(1 / REQUEST_PERIOD)
    assert served(server, 1, 5.0) == 0      # time that goes back costs nothing
    assert served(server, 1, 12.0) == 1
