# SPDX-License-Identifier: BSD-3-Clause
import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.web.requests import (
    DEFAULT_RATE,
    FIELDS,
    FOR_DRIVERS,
    MAX_SIZE,
    BadRequest,
    WantedImage,
    WantedMap,
    Watch,
    parse,
    watch_of,
)

GOOD = {
    'watch': {'robot': '', 'images': [{'stream': 'thermal', 'width': 320}],
              'map': {'stream': 'map', 'level': 1, 'area': [2, 1, 0, 3.5]}, 'points': ['scan'], 'cloud': None},
    'shown': {'number': 7}, 'ping': {'id': 1, 'clock': 12.5}, 'value': {'id': 1, 'stream': 'a', 'x': 0, 'y': 1},
    'still': {'id': 1, 'stream': 'a'}, 'captures': {'id': 0}, 'drive': {'tick': 1, 'x': 0.5, 'turn': -1},
    'halt': {}, 'control': {'id': 1, 'wish': 'take'}, 'estop': {'id': 1, 'engage': True}, 'neutral': {'id': 1},
    'focus': {'id': 1, 'focus': 'explore'}, 'goal': {'id': 1, 'x': 1.5, 'y': -2, 'yaw': 3.14},
    'capture': {'id': 1, 'stream': 'a'}}
"""{type: a good message of it}"""


def message(type_: str, **changes: Any) -> str:
    return json.dumps({'type': type_, **GOOD[type_], **changes})


def test_every_type_has_a_good_message() -> None:
    assert GOOD.keys() == FIELDS.keys() and FIELDS.keys() > FOR_DRIVERS
    for type_ in GOOD:
        assert parse(message(type_, more='ignored')).type == type_


def test_a_watch_is_complete() -> None:
    assert watch_of(parse(message('watch')).fields) == Watch(
        '', {'thermal': WantedImage(320, DEFAULT_RATE)}, WantedMap('map', 1, (0.0, 1.0, 2.0, 3.5)), False, ('scan',))
    assert watch_of(parse('{"type": "watch"}').fields) == Watch()


@pytest.mark.parametrize('type_, changes, problem', [
    ('drive', {'x': 1.01}, 'x must be a number from -1 to 1'), ('drive', {'x': True}, 'x must'),
    ('drive', {'x': '1'}, 'x must'), ('drive', {'x': None}, 'x must'), ('drive', {'tick': 1.5}, 'tick must'),
    ('drive', {'tick': -1}, 'tick must'), ('goal', {'yaw': 1e300}, 'yaw must'), ('goal', {'x': 10 ** 400}, 'x must'),
    ('control', {'wish': 'steal'}, 'wish must be take or release'), ('estop', {'engage': 1}, 'engage must'),
    ('focus', {'focus': 'x' * 101}, 'focus must be a text'), ('value', {'stream': 3}, 'stream must'),
    ('watch', {'images': [{'stream': 'a', 'width': 1}] * 9}, 'list of at most 8'),
    ('watch', {'images': [{'stream': 'a'}]}, 'width is missing'), ('watch', {'images': {}}, 'images must'),
    ('watch', {'images': [7]}, 'must be an object'), ('watch', {'map': {'stream': 'a', 'area': [0] * 5}}, 'at most 4'),
    ('watch', {'points': [None]}, 'points must'), ('ping', {'id': 2 ** 31}, 'id must')])
def test_a_wrong_field_is_named(type_, changes, problem) -> None:
    with pytest.raises(BadRequest, match=problem):
        parse(message(type_, **changes))


def test_an_area_has_four_numbers() -> None:
    with pytest.raises(BadRequest, match='area must have 4'):
        watch_of(parse(message('watch', map={'stream': 'map', 'area': [1, 2]})).fields)


@pytest.mark.parametrize('text', [
    '', 'null', '[]', '7', '"drive"', '{', '{"type": 1}', '{"type": "none"}', '{"type": ["drive"]}', '[' * MAX_SIZE,
    '{"a":' * 800, '{"type": "drive", "tick": 1, "turn": 0, "x": NaN}', 'x' * (MAX_SIZE + 1),
    '{"type": "drive", "tick": 1, "turn": 0, "x": 1e999}'])
def test_what_is_no_message_is_refused(text) -> None:
    with pytest.raises(BadRequest):
        parse(text)


def test_an_error_has_the_id_of_its_message() -> None:
    with pytest.raises(BadRequest) as refused:
        parse(message('goal', id=12, x='a'))
    assert refused.value.id == 12


LEAVES = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20)
VALUES = st.recursive(LEAVES, lambda inner: st.lists(inner, max_size=5) | st.dictionaries(
    st.sampled_from(['stream', 'width', 'rate', 'level', 'area', 'x']), inner, max_size=4), max_leaves=10)


@settings(max_examples=300, deadline=None)
@given(st.sampled_from(sorted(FIELDS)), st.dictionaries(st.sampled_from(
    sorted({name for fields in FIELDS.values() for name in fields})), VALUES, max_size=8))
def test_any_message_is_taken_or_refused(type_, changes) -> None:
    try:
        request = parse(json.dumps({'type': type_, **GOOD[type_], **changes}))
        if type_ == 'watch':
            watch = watch_of(request.fields)
            assert watch.map is None or watch.map.area[0] <= watch.map.area[2]
    except BadRequest:
        return
    assert request.fields.keys() == FIELDS[type_].keys()


@settings(max_examples=300, deadline=None)
@given(st.text(max_size=200))
def test_any_text_is_refused(text) -> None:
    with pytest.raises(BadRequest):
        parse(text)
