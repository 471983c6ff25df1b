# SPDX-License-Identifier: BSD-3-Clause
from typing import Any, Dict, List

import pytest

from smokebot_udp.mission.control import MissionControl
from smokebot_udp.mission.focus import load
from smokebot_udp.mission.parameters import Parameter
from smokebot_udp.mission.settings import SettingsStore

TABLE = {'rate': Parameter(10.0, 'Hz', 'how often', above=0.0, live=True),
         'weight': Parameter(1.0, '', 'a share', least=0.0, live=True),
         'low': Parameter(1, '', 'below high', live=True), 'high': Parameter(5, '', 'above low', live=True)}
PROFILES = '''
profiles:
  drive: {streams: {thermal: {rate: 8, weight: 4}, lidar: {rate: 5}}}
  look: {streams: {thermal: {rate: 4}}, others: {rate: 1}}
  wrong: {streams: {thermal: {rate: -1, low: 7, weight: 2}, lidar: {rate: 3, low: 9, high: 2}}}
'''


def in_order(requested: Any) -> None:
    if requested['low'] >= requested['high']:
        raise ValueError('low is not below high')


class Mission:
    """A mission of two streams, and what it reports."""

    def __init__(self) -> None:
        self.stores = {name: SettingsStore(TABLE, {'type': 'image', 'rate': 10.0, 'weight': 1.0, 'low': 1, 'high': 5},
                                           in_order) for name in ('thermal', 'lidar')}
        self.problems: List[str] = []
        self.switched: List[str] = []
        self.changes = 0
        self.control = MissionControl(self.stores, load(PROFILES)[0], self.problems.append, self.switched.append,
                                      self._changed)

    def _changed(self) -> None:
        self.changes += 1

    def requested(self, name: str) -> Dict[str, Any]:
        return dict(self.control.state().streams[name].requested)


def test_it_begins_as_configured_and_reports_wrong_profiles() -> None:
    mission = Mission()
    state = mission.control.state()
    assert (state.focus, state.modified) == ('default', frozenset())
    assert mission.control.profiles == ['default', 'drive', 'look', 'wrong']
    assert mission.problems == ["profile 'wrong', stream 'thermal': rate is -1, must be a number above 0 [Hz]"]
    assert mission.control.configured('lidar') == {'rate': 10.0, 'weight': 1.0, 'low': 1, 'high': 5}


def test_a_switch_sets_what_the_profile_names_and_resets_all_else() -> None:
    mission = Mission()
    mission.control.switch('drive')
    assert (mission.requested('thermal')['rate'], mission.requested('thermal')['weight']) == (8.0, 4.0)
    mission.control.switch('look')
    assert (mission.requested('thermal')['rate'], mission.requested('thermal')['weight']) == (4.0, 1.0)
    assert mission.requested('lidar')['rate'] == 1.0
    mission.control.switch('default')
    assert mission.requested('lidar')['rate'] == 10.0
    assert mission.switched == ['drive', 'look', 'default'] and mission.changes == 3
    assert mission.control.state().focus == 'default'


def test_a_switch_leaves_the_grants_of_settings_that_stay() -> None:
    mission = Mission()
    mission.stores['lidar'].grant({'rate': 2.0, 'low': 0})
    mission.control.switch('drive')
    assert mission.stores['lidar'].current.granted == {'low': 0}


def test_by_hand_stands_until_the_next_switch_even_to_the_same_focus() -> None:
    mission = Mission()
    mission.control.switch('drive')
    assert mission.control.request('thermal', {'rate': 3}) == {'rate': 3.0}
    assert mission.control.state().modified == {'thermal'} and mission.changes == 2
    assert mission.control.request('thermal', {'rate': 3}) == {} and mission.changes == 2
    assert mission.control.request_focus({'focus': 'drive'}) == {}
    assert mission.requested('thermal')['rate'] == 3.0
    mission.control.request_part('', {'focus': 'drive'})     # as an operator does
    assert mission.requested('thermal')['rate'] == 8.0 and not mission.control.state().modified


def test_the_focus_as_a_setting() -> None:
    mission = Mission()
    mission.control.request('lidar', {'weight': 9})
    assert mission.control.request_focus({'focus': 'look'}) == {'focus': 'look'}
    assert mission.requested('lidar')['rate'] == 1.0 and mission.requested('lidar')['weight'] == 1.0
    assert not mission.control.state().modified
    with pytest.raises(ValueError, match="focus is 'dance', must be one of default, drive, look, wrong"):
        mission.control.request_focus({'focus': 'dance'})
    assert mission.control.state().focus == 'look'


def test_a_refused_request_changes_and_marks_nothing() -> None:
    mission = Mission()
    for changes in ({'rate': -5}, {'colour': 'red'}, {'low': 7}):
        with pytest.raises(ValueError):
            mission.control.request('thermal', changes)
    for changes in ({'focus': 'dance'}, {'focus': 5}, {'rate': 1.0}):
        with pytest.raises(ValueError):
            mission.control.request_part('', changes)
    assert not mission.control.state().modified and not mission.changes and not mission.switched


def test_a_profile_that_a_stream_refuses_leaves_that_stream() -> None:
    mission = Mission()
    mission.control.switch('drive')
    del mission.problems[:]
    mission.control.switch('wrong')
    assert mission.problems == ["profile 'wrong', stream '%s' stays as it is: low is not below high" % name
                                for name in ('thermal', 'lidar')]
    assert mission.requested('lidar')['rate'] == 5.0 and mission.control.state().focus == 'wrong'


def test_a_profile_s_others_leave_the_package_s_own_streams() -> None:
    stores = {name: SettingsStore(TABLE, {'type': 'relay', 'message_type': message_type, 'rate': 10.0, 'weight': 1.0,
                                          'low': 1, 'high': 5})
              for name, message_type in (('status', 'smokebot_udp/RobotStatus'), ('link', 'smokebot_udp/LinkStatus'),
                                         ('odom', 'nav_msgs/Odometry'))}
    profiles = load('profiles: {a: {streams: {link: {rate: 2}}, others: {rate: 1}}, b: {streams: {link: {rate: 3}}}, '
                    'c: {streams: {camera: {rate: 4}}}}')[0]
    control = MissionControl(stores, profiles, pytest.fail, lambda focus: None, lambda: None)
    control.switch('a')
    assert {name: settings['rate'] for name, settings in control.state().streams.items()} == {
        'status': 10.0, 'link': 2.0, 'odom': 1.0}
    assert control.warning('a') is None and control.warning('default') is None
    for name in ('b', 'c'):     # they name none of the user's
        assert control.warning(name) == ("focus %s: its profile names no stream and no role of streams.yaml, so all "
                                         "stay as configured" % name)
    assert control.warnings == ["profile 'c': streams.yaml has no stream camera"]
