# SPDX-License-Identifier: BSD-3-Clause
"""The demo over a bad link: its arguments, and the keys that change the link."""
from typing import Any, Dict, List

import pytest

from smokebot_udp.demo.link import BAD, FIRST_OF_TWO, Path, arguments, changed, conditions, described, pressed_any


def test_arguments_have_defaults() -> None:
    values = arguments(['seconds:=30', 'rviz:=false'])
    assert values == {'link': 'bad', 'rviz': 'false', 'seconds': '30', 'picture': '', 'streams': '', 'seed': '1'}


@pytest.mark.parametrize('word', ['los:=0.2', 'seconds', 'seconds=3', 'seconds:=long', 'seed:=1.5', 'seed:=-1'])
def test_a_wrong_argument_is_named(word: str) -> None:
    with pytest.raises(ValueError, match=word.split(':=')[0].split('=')[0]):
        arguments([word])


def test_a_link_is_bad_or_as_told() -> None:
    assert conditions('bad') == BAD and conditions('two') == FIRST_OF_TWO
    assert conditions('loss=0.5,rate=1e6') == {'loss': 0.5, 'rate': 1e6}
    with pytest.raises(ValueError, match='good'):
        conditions('good')


def test_keys_change_loss_and_rate_within_bounds() -> None:
    link = {'loss': 0.2, 'rate': 2e6}
    assert changed(link, '+') == {'loss': 0.3, 'rate': 2e6}
    assert changed(link, '-') == {'loss': 0.1, 'rate': 2e6}
    assert changed(link, '>') == {'loss': 0.2, 'rate': 4e6}
    assert changed(link, '<') == {'loss': 0.2, 'rate': 1e6}
    assert changed(link, 'x') == link
    for _ in range(20):
        link = changed(changed(link, '+'), '<')
    assert link == {'loss': 0.95, 'rate': 1e5}
    assert changed({}, '-')['loss'] == 0.0


def test_a_link_in_words() -> None:
    assert described(BAD) == ' loses 20 %, carries 2 Mbit/s, and takes 20 ms'
    assert described({'loss': 0.0}) == ' loses 0 %, carries any rate, and takes 0 ms'


class Conditions:
    """Takes conditions as a Lab."""

    def set(self, conditions: Dict[str, Any]) -> None:
        self.now = conditions


def test_keys_cut_and_mend_each_of_two_links() -> None:
    labs: List[Any] = [Conditions() for _ in range(3)]
    paths = [Path('the first link', labs[:2], {'rate': 2e6}), Path('the second one', labs[2:], {'loss': 0.1})]
    assert pressed_any(paths, '1') and labs[0].now == labs[1].now == {'rate': 2e6, 'loss': 1.0}
    assert labs[2].now == {'loss': 0.1} and str(paths[0]) == 'the first link is cut'
    assert pressed_any(paths, '<') and labs[0].now == {'rate': 1e6, 'loss': 1.0}
    assert pressed_any(paths, '1') and labs[0].now == {'rate': 1e6}
    assert pressed_any(paths, '2') and labs[2].now == {'loss': 1.0}
    assert str(paths[0]) == 'the first link loses 0 %, carries 1 Mbit/s, and takes 0 ms'
    assert not pressed_any(paths, 'x') and not pressed_any(paths[:1], '1') and not pressed_any(paths[:1], '2')
