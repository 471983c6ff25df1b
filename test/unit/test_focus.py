# SPDX-License-Identifier: BSD-3-Clause
import pathlib
from typing import Dict

import pytest

from smokebot_udp.mission.focus import load, settings_of
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
    ('profiles: {a: {streams: {b: {floor: 1, min_bitrate: 1}}}}',
     "stream 'b': min_bitrate and its former name floor are both given"),
    ('profiles: {a: {extends: b}, b: {extends: a}}', 'extends itself'),
    ('profiles: {a: {extends: a}}', 'extends itself'),
    ('profiles: {a: {streams: [1]}}', 'is not settings'),
    ('profiles: {a: {streams: {b: 1}}}', 'is not settings'),
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


def test_former_names_are_accepted_with_one_warning_each() -> None:
    warnings = []
    profiles, problems = load('''
profiles:
  drive: {streams: {thermal: {floor: 100, taste: 0.5}}, others: {floor: 10}}
  creep: {extends: drive, streams: {thermal: {min_bitrate: 50}}}
''', warnings.append)
    assert not problems
    assert warnings == ["profile 'drive', stream 'thermal': floor is the former name of min_bitrate",
                        "profile 'drive', stream 'thermal': taste is the former name of degradation_preference",
                        "profile 'drive', others: floor is the former name of min_bitrate"]
    assert profiles['drive'].of('thermal') == {'min_bitrate': 100, 'degradation_preference': 0.5}
    assert profiles['creep'].of('thermal') == {'min_bitrate': 50, 'degradation_preference': 0.5}
    assert profiles['creep'].of('lidar') == {'min_bitrate': 10}


def test_one_wrong_profile_leaves_the_others() -> None:
    profiles, problems = load(TEXT + '  broken: 5\n')
    assert list(profiles) == ['drive', 'creep'] and len(problems) == 1


def shipped_streams() -> Dict[str, Table]:
    streams, _ = config.load((CONFIG / 'streams.yaml').read_text())
    return {name: live_tables(settings).robot for name, settings in streams.items()}


def test_the_shipped_profiles_fit_the_shipped_streams() -> None:
    profiles, problems = load((CONFIG / 'focus.yaml').read_text())
    assert not problems
    assert list(profiles) == ['navigation', 'inspection', 'mapping', 'localization', 'standby']
    streams = shipped_streams()
    good, problems = settings_of(profiles, streams)
    assert not problems
    assert good['standby']['camera'] == {'enabled': False} and good['standby']['tf'] == {'rate': 1.0}
    assert good['localization']['thermal']['enabled'] is False
    for profile in profiles.values():
        assert profile.use and set(profile.streams) <= set(streams)


def test_settings_that_are_none_are_left_out() -> None:
    profiles, _ = load('profiles: {a: {streams: {thermal: {rate: -5, leaf_size: 1.0, weight: 2}}}}')
    good, problems = settings_of(profiles, shipped_streams())
    assert good['a']['thermal'] == {'weight': 2.0}
    assert any('rate is -5' in problem for problem in problems)
    assert any('leaf_size: no such setting' in problem for problem in problems)
