# SPDX-License-Identifier: BSD-3-Clause
import pathlib
from typing import Any, Dict, List, Tuple

import pytest

from smokebot_udp.mission.focus import Limit, load, missing_streams, settings_of
from smokebot_udp.mission.parameters import Table
from smokebot_udp.streams import config, live_tables

CONFIG = pathlib.Path(__file__).parents[2] / 'config'

TEXT = '''
profiles:
  drive:
    use: Driving.
    streams:
      thermal: {rate: 10, weight: 4}
      lidar: {leaf_size: 0.2}
    others: {rate: 2}
  creep:
    extends: drive
    streams:
      thermal: {rate: 5}
      map: {enabled: false}
'''


def test_a_profile_names_streams_and_the_others() -> None:
    profiles, problems = load(TEXT)
    assert not problems and list(profiles) == ['drive', 'creep']
    drive = profiles['drive']
    assert drive.use == 'Driving.'
    assert drive.of('thermal') == {'rate': 10, 'weight': 4}
    assert drive.of('camera') == {'rate': 2}


def test_a_profile_that_extends_another_counts_first() -> None:
    creep = load(TEXT)[0]['creep']
    assert creep.use == 'Driving.'
    assert creep.of('thermal') == {'rate': 5, 'weight': 4}
    assert creep.of('lidar') == {'leaf_size': 0.2}
    assert creep.of('map') == {'rate': 2, 'enabled': False}
    assert creep.of('camera') == {'rate': 2}


@pytest.mark.parametrize('text, words', [
    ('profiles: {a: {extends: b}}', "extends 'b', which does not exist"),
    ('profiles: {a: {extends: b}, b: 5}', "extends 'b', which is wrong"),
    ('profiles: {a: {extends: [1]}}', 'extends [1], which does not exist'),
    ('profiles: {a: {extends: b}, b: {extends: c}, c: {extends: b}}', 'extends itself'),
    ('profiles: {a: {extends: b}, b: {extends: a}}', 'extends itself'),
    ('profiles: {a: {extends: a}}', 'extends itself'),
    ('profiles: {a: {streams: [1]}}', 'is not settings'),
    ('profiles: {a: {streams: {b: 1}}}', 'is not settings'),
    ('profiles: {a: {roles: [1]}}', 'roles: [1] is not settings'),
    ('profiles: {a: {roles: {cloud: 1}}}', "role 'cloud': 1 is not settings"),
    ('profiles: {a: {roles: {camera: {rate: 1}, map: {rate: 1}}}}', 'camera: no such role; there are primary_image, '),
    ('profiles: {a: {roles: {3: {rate: 1}}}}', '3: no such role'),
    ('profiles: {a: {others: x}}', 'is not settings'),
    ('profiles: {a: {rate: 1}}', 'it must have'),
    ('profiles: {a: 3}', 'it must have'),
    ('profiles: {3: {}}', 'not a text'),
    ('[', 'not valid YAML'), ('streams: {}', 'has no "profiles:"'), ('', 'has no "profiles:"')])
def test_what_is_wrong_is_told(text, words) -> None:
    profiles, problems = load(text)
    assert not profiles and any(words in problem for problem in problems)


def test_each_of_three_generations_overrides_those_before() -> None:
    profiles, problems = load(TEXT + """
  rest: {extends: creep, others: {enabled: false}, streams: {lidar: {rate: 1}}}
""")
    rest = profiles['rest']
    assert not problems
    assert rest.of('thermal') == {'rate': 5, 'weight': 4, 'enabled': False}
    assert rest.of('lidar') == {'leaf_size': 0.2, 'rate': 1}
    assert rest.of('map') == {'rate': 2, 'enabled': False}
    assert rest.of('camera') == {'rate': 2, 'enabled': False}


def test_one_wrong_profile_leaves_the_others() -> None:
    profiles, problems = load(TEXT + '  broken: 5\n')
    assert list(profiles) == ['drive', 'creep'] and len(problems) == 1


def of(text: str, profiles: str) -> Tuple[Dict[str, Dict[str, Dict[str, Any]]], List[str]]:
    """What profiles give to the streams of a streams.yaml."""
    streams, problems = config.load(text)
    assert not problems
    found, problems = load(profiles)
    assert not problems
    tables: Dict[str, Table] = {name: live_tables(settings).robot for name, settings in streams.items()}
    return settings_of(found, tables, streams)


def test_the_shipped_profiles_fit_the_shipped_streams() -> None:
    profiles, problems = load((CONFIG / 'focus.yaml').read_text())
    assert not problems
    assert list(profiles) == ['navigation', 'inspection', 'mapping', 'localization', 'standby']
    assert all(profile.use for profile in profiles.values())
    good, problems = of((CONFIG / 'streams.yaml').read_text(), (CONFIG / 'focus.yaml').read_text())
    assert not problems
    assert good['standby']['camera'] == {'enabled': False} and good['standby']['tf'] == {'rate': 1.0}
    assert good['standby']['thermal'] == {'rate': 1.0, 'scale': 4, 'weight': 1.0}
    assert good['standby']['status'] == {} and good['standby']['cmd_vel'] == {}
    assert good['localization']['camera']['enabled'] is False
    assert good['navigation']['map'] == {'rate': 0.5, 'repeat_rate': 0.1, 'weight': 0.5}
    assert good['navigation']['scan'] == good['navigation']['obstacle_scan'] == {
        'rate': 10.0, 'weight': 2.0, 'min_bitrate': 60.0}
    assert good['inspection']['landmark_scan'] == {'enabled': False}


OWN = """
streams:
  rear: {type: image, robot_topic: /a, operator_topic: /o/a, rate: 3, scale: 4}
  left_eye: {type: image, robot_topic: /b, operator_topic: /o/b}
  kinect: {type: cloud, robot_topic: /c, operator_topic: /o/c, rate: 2, leaf_size: 0.3}
  imu: {type: relay, message_type: sensor_msgs/Imu, robot_topic: /d, operator_topic: /o/d, rate: 40}
  costmap: {type: grid, robot_topic: /e, operator_topic: /o/e, enabled: false}
  sonar: {type: relay, message_type: sensor_msgs/Range, robot_topic: /f, operator_topic: /o/f}
  gear: {type: relay, message_type: std_msgs/Int8, robot_topic: /g, operator_topic: /o/g, reliable: true}
"""


def test_a_role_fits_any_robot_and_asks_for_no_more_than_streams_yaml_has() -> None:
    good, problems = of(OWN, """
profiles:
  drive:
    roles:
      primary_image: {rate: 20, weight: 4}
      secondary_image: {rate: 5, scale: 2}
      cloud: {rate: 1, leaf_size: 0.1}
      state: {rate: 10}
      map: {enabled: true, rate: 0.5}
      obstacles: {scale: 2}
    others: {rate: 1}
    streams: {left_eye: {scale: 3}}
""")
    assert not problems and good['drive'] == {
        'rear': {'rate': 3.0, 'weight': 4.0}, 'left_eye': {'rate': 5.0, 'scale': 3},
        'kinect': {'rate': 1.0, 'leaf_size': 0.3}, 'imu': {'rate': 10.0}, 'costmap': {'enabled': False, 'rate': 0.5},
        'sonar': {}, 'gear': {}, 'link': {}, 'status': {}}


def test_a_profile_s_later_generations_count_first_by_role_too() -> None:
    good, _ = of(OWN, """
profiles:
  base: {roles: {cloud: {rate: 1, weight: 3}}, streams: {imu: {rate: 50}}, others: {weight: 9}}
  heir: {extends: base, roles: {cloud: {weight: 2}, state: {rate: 5}}}
  rest: {extends: heir, others: {enabled: false}}
""")
    assert good['heir']['kinect'] == {'rate': 1.0, 'weight': 2.0} and good['base']['imu'] == {'rate': 50.0}
    assert good['heir']['imu'] == {'rate': 5.0}
    assert good['rest']['imu'] == {'rate': 5.0, 'enabled': False}
    assert good['rest']['rear'] == {'weight': 9.0, 'enabled': False}


def test_a_role_s_wrong_settings_are_reported_once() -> None:
    good, problems = of(OWN, 'profiles: {a: {roles: {primary_image: {rate: -5, weight: 2}, secondary_image: {colour: '
                        '1, leaf_size: 2}, map: {rate: fast}}}}')
    assert problems == ["profile 'a', role 'secondary_image': colour: no such setting",
                        "profile 'a', role 'primary_image': rate is -5, must be a number above 0 to 1000 [Hz]",
                        "profile 'a', role 'map': rate is 'fast', must be a number above 0 to 1000 [Hz]"]
    assert good['a']['left_eye'] == {} or good['a']['rear'] == {}


def test_streams_that_do_not_exist_are_warned_of() -> None:
    profiles, _ = load('profiles: {a: {streams: {thermal: {}, lidar: {rate: 1}, x: {}}}, b: {streams: {thermal: {}}, '
                       'extends: a}}')
    assert missing_streams(profiles, ['thermal']) == ["profile 'a': streams.yaml has no stream lidar, x"]
    assert profiles['b'].of('x') == {}


def test_what_is_said_of_a_role_is_a_limit() -> None:
    profiles, _ = load('profiles: {a: {roles: {cloud: {min_bitrate: 5}}}}')
    assert profiles['a'].of('x', 'cloud') == {'min_bitrate': Limit(5)}


def test_settings_that_are_none_are_left_out() -> None:
    good, problems = of((CONFIG / 'streams.yaml').read_text(),
                        'profiles: {a: {streams: {thermal: {rate: -5, leaf_size: 1.0, weight: 2}}}}')
    assert good['a']['thermal'] == {'weight': 2.0}
    assert any('rate is -5' in problem for problem in problems)
    assert any('leaf_size: no such setting' in problem for problem in problems)
