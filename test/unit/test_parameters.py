# SPDX-License-Identifier: BSD-3-Clause
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.mission.parameters import Parameter, check, check_one, live

RATE = Parameter(10.0, 'Hz', 'how often', above=0.0, most=1000.0, live=True)
COUNT = Parameter(3, '', 'how many', least=1, most=9)
ENABLED = Parameter(True, '', 'whether', live=True)
FILL = Parameter('nearest', '', 'how', choices=('nearest', 'unknown'))
TOPIC = Parameter(None, '', 'where it comes from')
UNIT = Parameter('', '', 'a name, or none')


@pytest.mark.parametrize('parameter, value, checked', [
    (RATE, 7, 7.0), (RATE, 0.5, 0.5), (RATE, 1000, 1000.0), (COUNT, 1, 1), (COUNT, 9, 9), (ENABLED, False, False),
    (FILL, 'unknown', 'unknown'), (TOPIC, '/t', '/t'), (UNIT, '', ''), (UNIT, 'degC', 'degC')])
def test_good_values_come_in_their_type(parameter: Parameter, value: Any, checked: Any) -> None:
    assert parameter.check(value) == checked and type(parameter.check(value)) is type(checked)


@pytest.mark.parametrize('parameter, value, words', [
    *[(RATE, value, 'must be a number above 0 to 1000 [Hz]')
      for value in (0, -1.0, 1000.5, float('nan'), float('inf'), True, '5', None, [5.0], 10 ** 400)],
    *[(COUNT, value, 'must be a whole number from 1 to 9') for value in (0, 10, 3.0, True, '3', 10 ** 400)],
    *[(ENABLED, value, 'must be true or false') for value in (0, 1, 'true', None)],
    *[(FILL, value, 'must be one of nearest, unknown') for value in ('', 'kriging', 5, ['nearest'])],
    *[(TOPIC, value, 'must be a text') for value in ('', 5, None)],
    (UNIT, 5, 'must be a text')])
def test_wrong_values_are_refused_in_words(parameter: Parameter, value: Any, words: str) -> None:
    with pytest.raises(ValueError) as refused:
        parameter.check(value)
    assert str(refused.value) == words


TABLE = {'topic': TOPIC, 'rate': RATE, 'count': COUNT}


def test_a_table_completes_values_by_its_defaults() -> None:
    assert check({'topic': '/t', 'count': 4}, TABLE) == {'topic': '/t', 'rate': 10.0, 'count': 4}
    assert list(live({**TABLE, 'enabled': ENABLED})) == ['rate', 'enabled']


@pytest.mark.parametrize('values, words', [
    ({'topic': '/t', 'colour': 1, 5: 2}, '5, colour: no such setting; there are count, rate, topic'),
    ({'rate': 5}, 'topic is missing: where it comes from'),
    ({'topic': '/t', 'count': 0}, 'count is 0, must be a whole number from 1 to 9')])
def test_a_table_names_what_is_wrong(values: Any, words: str) -> None:
    with pytest.raises(ValueError) as refused:
        check(values, TABLE)
    assert str(refused.value) == words
    with pytest.raises(ValueError, match='colour: no such setting'):
        check_one('colour', 'red', TABLE)


@given(st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(), st.lists(st.integers())))
def test_any_value_is_taken_in_its_type_or_refused(value: Any) -> None:
    for parameter in (RATE, COUNT, ENABLED, FILL, TOPIC, UNIT):
        try:
            assert type(parameter.check(value)) is parameter.kind
        except ValueError as error:
            assert str(error) == 'must be ' + parameter.allowed


def test_a_list_of_texts_is_a_text_where_that_is_allowed() -> None:
    several = Parameter('', '', 'names', many=True)
    assert several.check(['rgb', 'ring']) == several.check('rgb, ring') == 'rgb, ring' and several.check([]) == ''
    for parameter, value in (several, ['rgb', 1]), (Parameter('', '', 'name'), ['rgb']):
        with pytest.raises(ValueError, match='must be a text'):
            parameter.check(value)
