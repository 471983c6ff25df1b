# SPDX-License-Identifier: BSD-3-Clause
import pathlib
from types import SimpleNamespace

import pytest

from smokebot_udp.mission.focus import load
from smokebot_udp.nodes.focus import valid_profiles
from smokebot_udp.streams import config, robot_class

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


def test_a_profile_names_streams_and_the_others():
    profiles, problems = load(TEXT)
    assert not problems and list(profiles) == ['drive', 'creep']
    drive = profiles['drive']
    assert drive.use == 'Driving.'
    assert drive.of('thermal') == {'rate': 10, 'weight': 4}
    assert drive.of('camera') == {'rate': 2}


def test_a_profile_that_extends_another_counts_first():
    creep = load(TEXT)[0]['creep']
    assert creep.use == 'Driving.'
    assert creep.of('thermal') == {'rate': 5, 'weight': 4}
    assert creep.of('lidar') == {'leaf_size': 0.2}
    assert creep.of('map') == {'rate': 2, 'enabled': False}
    assert creep.of('camera') == {'rate': 2}


@pytest.mark.parametrize('text, words', [
    ('profiles: {a: {extends: b}}', "extends 'b', which is not there"),
    ('profiles: {a: {extends: b}, b: {extends: a}}', 'extends itself'),
    ('profiles: {a: {extends: a}}', 'extends itself'),
    ('profiles: {a: {streams: [1]}}', 'is no settings'),
    ('profiles: {a: {streams: {b: 1}}}', 'is no settings'),
    ('profiles: {a: {others: x}}', 'is no settings'),
    ('profiles: {a: {rate: 1}}', 'has to have'),
    ('profiles: {a: 3}', 'has to have'),
    ('profiles: {3: {}}', 'no text'),
    ('[', 'no YAML'), ('streams: {}', 'has no "profiles:"'), ('', 'has no "profiles:"')])
def test_what_is_wrong_is_told(text, words):
    profiles, problems = load(text)
    assert not profiles and any(words in problem for problem in problems)


def test_one_wrong_profile_leaves_the_others():
    profiles, problems = load(TEXT + '  broken: 5\n')
    assert list(profiles) == ['drive', 'creep'] and len(problems) == 1


def shipped_streams():
    streams, _ = config.load((CONFIG / 'streams.yaml').read_text())
    return {name: SimpleNamespace(PARAMETERS=robot_class(settings['type']).PARAMETERS)
            for name, settings in streams.items()}


def test_the_shipped_profiles_fit_the_shipped_streams():
    profiles, problems = load((CONFIG / 'focus.yaml').read_text())
    assert not problems
    assert list(profiles) == ['navigation', 'inspection', 'mapping', 'localization', 'standby']
    streams = shipped_streams()
    good, problems = valid_profiles(profiles, streams)
    assert not problems
    assert good['standby']['camera'] == {'enabled': False} and good['standby']['tf'] == {'rate': 1.0}
    assert good['localization']['thermal']['enabled'] is False
    for profile in profiles.values():
        assert profile.use and set(profile.streams) <= set(streams)


def test_settings_that_are_none_are_left_out():
    profiles, _ = load('profiles: {a: {streams: {thermal: {rate: -5, leaf_size: 1.0, weight: 2}}}}')
    good, problems = valid_profiles(profiles, shipped_streams())
    assert good['a']['thermal'] == {'weight': 2.0}
    assert any('rate is -5' in problem for problem in problems)
    assert any('leaf_size: no such setting' in problem for problem in problems)
