# SPDX-License-Identifier: BSD-3-Clause
"""Files that users write: odd YAML gives problems in words, and no other exception."""
from typing import Any, Callable

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.mission import focus
from smokebot_udp.mission.parameters import LINK_STATUS
from smokebot_udp.mission.yaml_text import read_yaml
from smokebot_udp.streams import config

LOADERS = [config.load, focus.load]
STREAM = {'type': 'relay', 'message_type': 'std_msgs/String', 'robot_topic': '/in', 'operator_topic': '/out'}

scalars = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.dates() | st.binary(
    max_size=4)
words = st.sampled_from([*config.parameters_of('relay'), *config.parameters_of('image'), 'relay', 'image', 'extends',
                         'use', 'others', 'streams', 'thermal', 'std_msgs/String'])
values = st.recursive(scalars | words, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(
    words | scalars, inner, max_size=4), max_leaves=12)


@pytest.mark.parametrize('load', LOADERS)
@pytest.mark.parametrize('text', [
    'streams: {? [a, b] : {}}', 'streams: {thermal: {? [rate] : 5}}', 'profiles: {? {a: b} : {}}', '? [a, b]\n: c',
    'streams: {thermal: {rate: 2001-13-45}}', 'a: !!bool x', 'a: !!int ""', 'a: \x07', 'a: !!python/object:os.system x',
    '[' * 5000, 'a: *b', '&a [*a]: x', '<<: [1]'])
def test_what_is_no_yaml_is_one_problem(load: Callable[..., Any], text: str) -> None:
    good, problems = load(text)
    assert good == {} and len(problems) == 1 and problems[0].startswith('not valid YAML: ')


def test_a_list_as_key_is_located() -> None:
    assert config.load('streams:\n  thermal: {type: relay}\n  ? [a, b]\n  : {type: relay}')[1] == [
        'not valid YAML: while constructing a mapping in "<unicode string>", line 2, column 3: thermal: {type: relay} '
        '^ found unhashable key in "<unicode string>", line 3, column 5: ? [a, b] ^']


def test_an_empty_text_is_valid() -> None:
    assert read_yaml('') == (None, [])
    assert config.load('')[1] == ['it has no "streams:" with the streams by name']
    assert focus.load('')[1] == ['it has no "profiles:" with the profiles by name']


def test_a_profile_that_stands_twice() -> None:
    profiles, problems = focus.load('profiles:\n  a: {use: first}\n  a: {use: second}\n')
    assert profiles['a'].use == 'first'
    assert problems == ["'a' is given twice, again in line 3: the first one counts"]


@pytest.mark.parametrize('load', LOADERS)
@given(st.text() | values.map(lambda value: str(yaml.safe_dump(value))))
@settings(deadline=None)
def test_any_text(load: Callable[..., Any], text: str) -> None:
    good, problems = load(text)
    assert isinstance(good, dict) and all(isinstance(problem, str) for problem in problems)


@given(st.dictionaries(words | scalars, values, max_size=4))
@settings(deadline=None)
def test_any_settings_of_a_stream(odd: Any) -> None:
    text = yaml.safe_dump({'streams': {'odd': {**STREAM, **odd}, 'good': {**STREAM, 'operator_topic': '/good'}}})
    streams, problems = config.load(text)
    assert 'good' in streams or problems
    assert 'odd' in streams or any(problem.startswith("stream 'odd': ") for problem in problems)


@given(st.dictionaries(words | scalars, values, max_size=4), st.dictionaries(words | scalars, values, max_size=3))
@settings(deadline=None)
def test_any_profiles(odd: Any, streams: Any) -> None:
    text = yaml.safe_dump({'profiles': {'good': {'use': 'x'}, 'odd': odd, 'named': {'streams': streams}}})
    tables = {'thermal': config.parameters_of('image'), 'link': config.parameters_of('relay')}
    profiles, problems = focus.load(text)
    assert 'good' in profiles and {'odd', 'named'} - set(profiles) <= {
        name for name in ('odd', 'named') for problem in problems if problem.startswith('profile %r: ' % name)}
    focus.settings_of(profiles, tables, {'thermal': {'type': 'image'},
                                         'link': {'type': 'relay', 'message_type': LINK_STATUS}})
