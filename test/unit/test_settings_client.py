# SPDX-License-Identifier: BSD-3-Clause
"""The operator's copy of the robot's settings; and both halves together over a link whose sessions end."""
from typing import Any, Dict, List, Tuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.mission.control import MissionControl
from smokebot_udp.mission.focus import load
from smokebot_udp.mission.parameters import Parameter
from smokebot_udp.mission.remote import PartState, Request
from smokebot_udp.mission.settings import SettingsStore
from smokebot_udp.mission.settings_client import MAX_WAITING, TIMEOUT, SettingsClient
from smokebot_udp.mission.settings_server import SettingsServer

TABLE = {'rate': Parameter(10.0, 'Hz', 'how often', above=0.0, live=True),
         'weight': Parameter(1.0, '', 'a share', least=0.0, live=True)}
PROFILES = ('default', 'drive')


def make(*parts: PartState) -> SettingsClient:
    client = SettingsClient({'thermal': TABLE, 'map': TABLE})
    for part in parts or (thermal(), focus('default')):
        client.receive(part)
    client.take_news()
    return client


def thermal(request: int = 0, refusal: str = '', **values: Any) -> PartState:
    return PartState('thermal', {'rate': 10.0, 'weight': 1.0, **values}, (), request, refusal)


def focus(name: str, request: int = 0, refusal: str = '', changes: str = '') -> PartState:
    return PartState('', {'focus': name}, PROFILES, request, refusal, changes)


def test_a_part_is_known_from_its_first_state_on() -> None:
    client = SettingsClient({'thermal': TABLE})
    assert not client.stores and not client.news and client.deadline() is None
    client.receive(thermal(rate=3.0))
    client.receive(focus('drive'))
    assert client.news and client.take_news() == ([], ['thermal', '']) and not client.news
    assert client.stores['thermal'].current.requested == {'rate': 3.0, 'weight': 1.0}
    assert client.stores[''].current['focus'] == 'drive'
    with pytest.raises(ValueError, match='must be one of default, drive'):
        client.request('', {'focus': 'dancing'}, 0.0)


def test_what_the_robot_changes_is_news() -> None:
    client = make()
    client.receive(thermal(rate=3.0))
    assert client.take_news() == ([], ['thermal']) and client.stores['thermal'].current['rate'] == 3.0
    client.receive(thermal(rate=3.0))
    assert not client.news


def test_a_request_is_sent_once_in_a_session_until_it_is_answered() -> None:
    client = make()
    assert client.request('thermal', {'rate': 5}, 100.0) == {'rate': 5.0}
    assert client.stores['thermal'].current['rate'] == 5.0 and not client.news     # who asked knows
    for now in (100.0, 101.0):
        assert client.poll(now) == Request(1, 'thermal', {'rate': 5.0}) and client.poll(now) is None
        assert client.deadline() == 100.0 + TIMEOUT
        client.begin_again()
    client.receive(thermal())       # of before: the change still stands
    assert client.stores['thermal'].current['rate'] == 5.0
    client.receive(thermal(1, rate=5.0))
    assert client.deadline() is None and not client.news
    client.begin_again()
    assert client.poll(102.0) is None


def test_a_refused_change_is_set_back_with_the_reason() -> None:
    client = make()
    client.request('thermal', {'rate': 5, 'weight': 2}, 0.0)
    client.poll(0.0)
    client.receive(thermal(1, 'not on Sundays'))
    assert client.take_news() == ([('thermal', 'rate 5.0, weight 2.0 refused: not on Sundays')], ['thermal'])
    assert client.stores['thermal'].current.requested == {'rate': 10.0, 'weight': 1.0}
    assert client.deadline() is None


def test_a_change_without_an_answer_is_set_back_in_time() -> None:
    client = make()
    client.request('thermal', {'rate': 5}, 0.0)
    client.request('', {'focus': 'drive'}, 4.0)
    assert client.poll(TIMEOUT - 0.1) is not None and client.poll(TIMEOUT - 0.1) is None and not client.news
    assert client.poll(TIMEOUT) == Request(2, '', {'focus': 'drive'})
    assert client.take_news() == ([('thermal', 'rate 5.0 refused: the robot did not answer in 10 s')], ['thermal'])
    assert client.stores['thermal'].current['rate'] == 10.0 and client.stores[''].current['focus'] == 'drive'


def test_a_switch_is_requested_even_to_the_same_focus_and_shown_with_its_answer() -> None:
    client, answers = make(), []
    for name in ('default', 'drive', 'dance'):
        client.switch(name, 3.0, 0.0, lambda *answer: answers.append(answer))
    client.request('', {'focus': 'drive'}, 0.0)     # by rosparam: a change of its own
    assert client.poll(0.0) == Request(1, '', {'focus': 'default'})
    client.receive(focus('default', 1, '', 'thermal off'))
    assert client.poll(0.1) == Request(2, '', {'focus': 'drive'})
    client.receive(focus('drive', 2))
    assert client.poll(0.2) == Request(3, '', {'focus': 'dance'})
    client.receive(focus('drive', 3, 'no such focus'))
    assert answers == [('', 'thermal off'), ('', ''), ('no such focus', '')]
    assert client.poll(0.3) == Request(4, '', {'focus': 'drive'})
    assert client.take_news()[0] == [] and client.stores[''].current['focus'] == 'drive'


def test_a_switch_is_given_up_after_its_own_timeout_also_where_no_robot_was_ever_heard() -> None:
    client, answers = SettingsClient({}), []
    client.switch('drive', 3.0, 0.0, lambda *answer: answers.append(answer))
    assert client.poll(2.9) == Request(1, '', {'focus': 'drive'}) and not answers
    assert client.poll(3.0) is None and answers == [('the robot did not answer in 3 s', '')]
    assert client.deadline() is None and not client.news


def test_one_request_after_the_other_in_their_order() -> None:
    client = make()
    client.request('', {'focus': 'drive'}, 0.0)
    first = client.poll(0.0)
    client.request('thermal', {'rate': 5}, 0.1)
    client.request('thermal', {'weight': 3}, 0.1)      # in one with the one before
    client.request('', {'focus': 'default'}, 0.1)
    assert first == Request(1, '', {'focus': 'drive'}) and client.poll(0.1) is None
    client.receive(focus('drive', 1))
    assert client.stores[''].current['focus'] == 'default'     # as requested last
    assert client.poll(0.2) == Request(2, 'thermal', {'rate': 5.0, 'weight': 3.0})
    client.receive(thermal(rate=8.0))    # of the switch
    assert client.stores['thermal'].current.requested == {'rate': 5.0, 'weight': 3.0}
    client.receive(thermal(2, rate=5.0, weight=3.0))
    assert client.poll(0.3) == Request(3, '', {'focus': 'default'})


def test_a_change_during_a_request_for_the_same_part_is_requested_after_it() -> None:
    client = make()
    client.request('thermal', {'rate': 5}, 0.0)
    sent = client.poll(0.0)
    client.request('thermal', {'rate': 6}, 0.0)
    assert sent == Request(1, 'thermal', {'rate': 5.0})
    client.receive(thermal(1, rate=5.0))
    assert client.stores['thermal'].current['rate'] == 6.0
    assert client.poll(0.1) == Request(2, 'thermal', {'rate': 6.0})


def test_changes_that_wait_are_limited() -> None:
    client = make(thermal(), PartState('map', {'rate': 1.0}))
    for number in range(MAX_WAITING // 2):
        client.request('thermal', {'rate': 100 + number}, 0.0)
        client.request('map', {'rate': 100 + number}, 0.0)
    with pytest.raises(ValueError, match='64 changes wait for the robot already'):
        client.request('thermal', {'rate': 50}, 0.0)


def test_what_another_version_sends_is_left_out_and_said_once() -> None:
    client = make()
    for _ in range(2):
        client.receive(thermal(rate=-1.0, colour='red', weight=2.0))
    problems, changed = client.take_news()
    assert problems == [('thermal', "the robot's value is not shown: rate is -1.0, must be a number above 0 [Hz]"),
                        ('thermal', "the robot's value is not shown: colour: no such setting; there are rate, weight")]
    assert changed == ['thermal'] and client.stores['thermal'].current.requested == {'rate': 10.0, 'weight': 2.0}
    client.receive(PartState('lidar', {}))
    assert client.dropped == {'unknown part': 1}


class Link:
    """Both halves, and what is on the way between them, in order; it is lost where a session ends."""

    def __init__(self) -> None:
        stores = {name: SettingsStore(TABLE, {'type': 'image', 'rate': 10.0, 'weight': 1.0}, self.check)
                  for name in ('thermal', 'map')}
        profiles, _ = load('profiles: {drive: {streams: {thermal: {rate: 4}}}}')
        self.control = MissionControl(stores, profiles, lambda _: None, lambda _: None, lambda: None)
        self.server = SettingsServer(self.control.profiles)
        self.down, self.up = self.server.update(self.control.parts()), []     # type: List[PartState], List[Request]
        self.client = make(*self.down)
        self.applied: List[Tuple[str, Dict[str, Any]]] = []
        self.now = 0.0

    @staticmethod
    def check(requested: Any) -> None:
        if requested['weight'] > requested['rate']:
            raise ValueError('weight is above rate')

    def serve(self, request: Request) -> None:
        refusal = ''
        try:
            self.server.check(request, self.now)
            self.applied.append((request.part, dict(request.values)))
            self.control.request_part(request.part, request.values)
        except ValueError as error:
            refusal = str(error)
        self.down += [*self.server.update(self.control.parts()), self.server.answer(request, refusal)]

    def begin_session(self) -> None:
        self.up, self.down = [], self.server.states()
        self.client.begin_again()

    def step(self, ups: int, downs: int) -> None:
        """A moment passes; so many messages are delivered."""
        self.now += 0.2
        request = self.client.poll(self.now)
        self.up += [request] if request else []
        for request in self.up[:ups]:
            self.serve(request)
        for state in self.down[:downs]:
            self.client.receive(state)
        del self.up[:ups], self.down[:downs]


CHANGES = st.lists(st.tuples(st.sampled_from(['', 'thermal', 'map']), st.integers(1, 20)), min_size=1, max_size=12)


@settings(max_examples=60, deadline=None)
@given(CHANGES, st.lists(st.tuples(st.integers(0, 2), st.integers(0, 3), st.booleans()), min_size=1, max_size=40))
def test_both_sides_agree_in_the_end(changes: List[Tuple[str, int]], fates: List[Tuple[int, int, bool]]) -> None:
    link, ended = Link(), 0
    for step in range(max(len(changes), len(fates))):
        if step < len(changes):
            part, number = changes[step]
            wanted = {'focus': PROFILES[number % 2]} if part == '' else {
                'weight' if number % 3 else 'rate': float(number)}
            link.client.request(part, wanted, link.now)
        ups, downs, ends = fates[step % len(fates)]
        if ends and ended < 5:
            link.begin_session()
            ended += 1
        link.step(ups, downs)
    for _ in range(60):
        link.step(9, 9)
    assert link.client.deadline() is None
    for part, values in link.control.parts().items():
        assert dict(link.client.stores[part].current.requested) == values
    assert len(link.applied) <= len(changes) + ended
