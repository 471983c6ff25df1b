# SPDX-License-Identifier: BSD-3-Clause
import threading
from typing import Any, Dict, List, Mapping, Optional, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.mission.parameters import Parameter
from smokebot_udp.mission.settings import Settings, SettingsStore

TABLE = {'rate': Parameter(10.0, 'Hz', 'how often', above=0.0, most=100.0, live=True),
         'low': Parameter(1, '', 'not above high', least=0, most=9, live=True),
         'high': Parameter(5, '', 'not below low', least=0, most=9, live=True),
         'enabled': Parameter(True, '', 'whether', live=True)}
START = {'topic': '/t', 'rate': 10.0, 'low': 1, 'high': 5, 'enabled': True}


def in_order(requested: Mapping[str, Any]) -> None:
    if requested['low'] > requested['high']:
        raise ValueError('low is %d, above high, %d' % (requested['low'], requested['high']))


class Listener:
    """Notes what a store calls it with."""

    def __init__(self, store: SettingsStore) -> None:
        self.heard: List[Tuple[Settings, Mapping[str, Any]]] = []
        store.subscribe(lambda settings, changed: self.heard.append((settings, changed)))


def test_at_the_start_all_requested_is_in_effect() -> None:
    store = SettingsStore(TABLE, START, in_order)
    assert dict(store.current) == START == store.current.requested
    assert store.current.granted == {} and not store.current.paused
    with pytest.raises(ValueError, match='low is 7, above high, 5'):
        SettingsStore(TABLE, {**START, 'low': 7}, in_order)


def test_a_request_is_a_true_delta() -> None:
    store = SettingsStore(TABLE, START, in_order)
    listener = Listener(store)
    assert store.request({'rate': 10, 'low': 2, 'high': 5, 'enabled': True}) == {'low': 2}
    (settings, changed), = listener.heard
    assert changed == {'low': 2} and settings is store.current
    assert store.request({'rate': 10.0, 'low': 2}) == {}
    assert len(listener.heard) == 1


def test_a_change_of_one_setting_leaves_the_grants_of_all_others() -> None:
    """Once any live setting erased every grant: the whole table was passed as the change."""
    store = SettingsStore(TABLE, START, in_order)
    store.grant({'rate': 3.0, 'high': 2})
    assert (store.current['rate'], store.current['high']) == (3.0, 2)
    store.request({name: value for name, value in START.items() if name in TABLE and name != 'enabled'})
    store.request({'enabled': False})
    assert store.current.granted == {'rate': 3.0, 'high': 2} and store.current['rate'] == 3.0
    store.request({'rate': 5.0})
    assert store.current.granted == {'high': 2} and store.current['rate'] == 5.0


def test_what_is_refused_changes_nothing() -> None:
    store = SettingsStore(TABLE, START, in_order)
    store.grant({'rate': 3.0})
    listener, before = Listener(store), store.current
    for changes, words in (({'rate': 4.0, 'low': -1}, 'low is -1'), ({'rate': 4.0, 'low': 6}, 'low is 6, above high'),
                           ({'rate': 4.0, 'topic': '/u'}, 'topic: no such setting'), ({'colour': 'red'}, 'colour')):
        with pytest.raises(ValueError, match=words):
            store.request(changes)
    assert store.current is before and not listener.heard


def test_a_pause_ends_with_the_next_grant_and_takes_requests() -> None:
    store = SettingsStore(TABLE, START, in_order)
    listener = Listener(store)
    store.grant(None)
    store.grant(None)
    assert store.current.paused and store.current['rate'] == 10.0
    store.request({'rate': 2.0})
    assert store.current.paused and store.current['rate'] == 2.0
    store.grant({})
    assert not store.current.paused
    assert [changed for _, changed in listener.heard] == [{}, {'rate': 2.0}, {}]


def test_a_snapshot_never_changes() -> None:
    store = SettingsStore(TABLE, START, in_order)
    limits = {'rate': 3.0}
    store.grant(limits)
    snapshot = store.current
    limits['rate'] = 1.0
    store.request({'low': 0})
    store.grant({})
    assert dict(snapshot) == {**START, 'rate': 3.0}


VALUES = {'rate': st.floats(-1, 101), 'low': st.integers(-1, 10), 'high': st.integers(-1, 10),
          'enabled': st.booleans(), 'colour': st.text(max_size=1)}
CHANGES = st.fixed_dictionaries({}, optional=VALUES)
GRANTS = st.one_of(st.none(), st.fixed_dictionaries({}, optional={'rate': st.floats(0.1, 100), 'high': VALUES['high']}))


@given(st.lists(st.one_of(st.tuples(st.just('request'), CHANGES), st.tuples(st.just('grant'), GRANTS)), max_size=12))
def test_requested_granted_and_effective_stay_consistent(steps: List[Tuple[str, Optional[Dict[str, Any]]]]) -> None:
    store = SettingsStore(TABLE, START, in_order)
    listener = Listener(store)
    effective = dict(store.current)
    for action, values in steps:
        before, heard = store.current, len(listener.heard)
        if action == 'grant':
            store.grant(values)
            assert store.current.granted == values and store.current.requested == before.requested
        else:
            assert values is not None
            try:
                delta = store.request(values)
            except ValueError:
                assert store.current is before and len(listener.heard) == heard
                continue
            in_order(store.current.requested)
            assert delta == {name: value for name, value in values.items() if value != before.requested[name]}
            assert store.current.requested == {**before.requested, **delta}
            assert store.current.paused == before.paused
            assert (store.current.granted or {}) == {
                name: value for name, value in (before.granted or {}).items() if name not in delta}
        now = store.current
        assert dict(now) == {**now.requested, **(now.granted or {})}
        for _, changed in listener.heard[heard:]:
            effective.update(changed)       # who follows the changes alone has the same values
        assert effective == dict(now)


def test_threads_lose_no_request() -> None:
    table = {str(number): Parameter(0, '', 'a count', live=True) for number in range(4)}
    store = SettingsStore(table, {name: 0 for name in table})

    def count(name: str) -> None:
        for value in range(1, 201):
            store.request({name: value})
            store.grant({'rate': value})
    threads = [threading.Thread(target=count, args=(name,)) for name in table]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert store.current.requested == {name: 200 for name in table}
