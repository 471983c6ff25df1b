# SPDX-License-Identifier: BSD-3-Clause
"""Layers of pieces: by hand, any datagrams in any order, contradictions."""
from random import Random
from typing import List

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip('numba')

from smokebot_udp.codecs.layered.pieces import (  # noqa: E402
    MAX_LAYERS,
    Layer,
    Plan,
    Restorer,
    codes_of,
    parts_of,
    protect,
)


def stream_of(plan: Plan, seed: int = 1) -> bytes:
    """Random bytes that fill all layers."""
    return np.random.RandomState(seed).bytes(sum(
        layer.size * layer.threshold * parts_of(layer.threshold, plan.count) for layer in plan.layers))


def restorer_of(plan: Plan, data: bytes, indexes: List[int]) -> Restorer:
    restorer = Restorer(plan.count, plan.layers)
    assert restorer.add(np.array(indexes, int), protect(data, plan)[indexes]).all()
    return restorer


def test_datagrams_by_hand() -> None:
    plan = Plan(4, [Layer(1, 2), Layer(3, 1)])
    pieces = protect(b'abcde', plan)
    assert pieces.shape == (4, 3)
    assert pieces[0, :2].tobytes() == b'ab' and pieces[:3, 2].tobytes() == b'cde'
    # 1 / 2 and 1 / 3 in GF(256) are 0x8e and 0xf4: 'a' / 2, and 'c' / 3 + 'd' / 2 + 'e' / 1
    assert pieces[2, 0] == 0xbe and pieces[3, 2] == 0x76


def test_zeros_fill_the_last_layer_and_the_rest_is_left_out() -> None:
    plan = Plan(3, [Layer(2, 3)])
    assert restorer_of(plan, b'abcd', [0, 2]).restored() == b'abcd\0\0'
    assert restorer_of(plan, b'abcdefgh', [1, 2]).restored() == b'abcdef'
    assert restorer_of(plan, b'', [1, 2]).restored() == bytes(6)


def test_layer_by_layer() -> None:
    plan = Plan(6, [Layer(1, 3), Layer(2, 5), Layer(5, 4)])
    data = stream_of(plan)
    pieces = protect(data, plan)
    restorer = Restorer(plan.count, plan.layers)
    assert (restorer.restorable, restorer.restored(), restorer.completeness, restorer.awaited) == (0, b'', 0.0, 5)
    # two of 5 that are needed came: without 2, 3 and 4 are too few
    expected = [(1, 3, 5), (2, 13, 2), (2, 13, 2), (2, 13, 4), (3, 33, None)]
    for index, (restorable, length, awaited) in zip([1, 5, 3, 2, 4], expected):
        assert restorer.add(np.array([index]), pieces[index:index + 1]).tolist() == [True]
        assert (restorer.restorable, restorer.restored()) == (restorable, data[:length])
        assert awaited is None or restorer.awaited == awaited
    assert restorer.complete and restorer.completeness == pytest.approx(5 / 6)


def test_source_pieces_beyond_the_restorable_layers() -> None:
    plan = Plan(10, [Layer(2, 1), Layer(8, 4)])
    data = stream_of(plan)
    restorer = restorer_of(plan, data, [0, 1, 2, 4, 9])
    assert restorer.restorable == 1
    assert restorer.restored() == data[:2 + 3 * 4]


@st.composite
def plans(draw) -> Plan:
    codes = draw(st.integers(1, 3))
    count = codes * draw(st.integers(1, 60) if codes == 1 else st.integers(161 if codes == 3 else 121, 180))
    thresholds = draw(st.sets(st.integers(1, count // codes), min_size=1, max_size=5))
    return Plan(count, [Layer(threshold, draw(st.integers(1, 6))) for threshold in sorted(thresholds)])


@given(plans(), st.floats(0, 1), st.randoms(use_true_random=False))
@settings(max_examples=80, deadline=None)
def test_any_datagrams_in_any_order(plan: Plan, share: float, random: Random) -> None:
    count, data = plan.count, stream_of(plan)
    assert codes_of(count) == -(-count // 240)
    pieces = protect(data, plan)
    restorer = Restorer(plan.count, plan.layers)
    indexes = random.sample(range(count), round(share * count))
    while indexes:
        batch, indexes = indexes[:40], indexes[40:]
        before = restorer.restorable
        assert restorer.add(np.array(batch), pieces[batch]).all()
        assert restorer.restorable >= before
        if random.random() < 0.3:
            assert data.startswith(restorer.restored())
    restored = restorer.restored()
    assert data.startswith(restored)
    sizes = [layer.size * layer.threshold * parts_of(layer.threshold, count) for layer in plan.layers]
    assert len(restored) >= sum(sizes[:restorer.restorable])
    if count <= 240:
        assert restorer.restorable == sum(layer.threshold <= round(share * count) for layer in plan.layers)
    assert restorer.complete == (restored == data) or len(restored) == len(data)


def test_several_codes() -> None:
    plan = Plan(480, [Layer(80, 2), Layer(81, 3)])
    assert [parts_of(layer.threshold, 480) for layer in plan.layers] == [1, 2]
    data = stream_of(plan)
    # the second half repeats the first one's pieces of the first layer
    copies = restorer_of(plan, data, list(range(40)) + list(range(240 + 20, 240 + 80)))
    assert copies.restorable == 1 and copies.restored()[:160] == data[:160]
    assert restorer_of(plan, data, list(range(39)) + list(range(240, 240 + 79))).restorable == 0
    # of the second layer both codes need 81: the even datagrams and the odd ones
    evens, odds = list(range(0, 400, 2)), list(range(1, 163, 2))
    assert restorer_of(plan, data, evens + odds[:-1]).restorable == 1
    assert restorer_of(plan, data, evens + odds).complete


def test_what_does_not_fit_changes_nothing() -> None:
    plan = Plan(5, [Layer(1, 2), Layer(2, 2)])
    data = stream_of(plan)
    pieces = protect(data, plan)
    restorer = Restorer(plan.count, plan.layers)
    forged = np.full((4, 4), 255, np.uint8)
    assert restorer.add(np.array([5, -1, 1 << 40, -1 << 62]), forged).tolist() == [False] * 4
    assert restorer.add(np.array([0]), forged[:1, :3]).tolist() == [False]
    assert restorer.add(np.array([], int), forged[:0]).tolist() == []
    assert restorer.restorable == 0
    batch = np.array([3, 3, 9, 0])
    assert restorer.add(batch, np.vstack([pieces[3], forged[0], forged[0], pieces[0]])).tolist() == [
        True, False, False, True]
    assert restorer.add(np.array([3]), forged[:1]).tolist() == [False]
    assert restorer.complete and restorer.restored() == data


def test_numbers_of_a_record() -> None:
    restorer = Restorer(np.uint16(17), [Layer(np.uint8(5), np.uint16(300))])     # as they are in a segment
    assert restorer.add(np.arange(17), np.zeros((17, 300), np.uint8)).all() and restorer.complete


@pytest.mark.parametrize('count, layers, message', [
    (0, [Layer(1, 1)], 'datagrams'), (4081, [Layer(1, 1)], 'datagrams'), (65535, [Layer(1, 1)], 'datagrams'),
    (241, [Layer(1, 1)], 'datagrams'), (-4, [Layer(1, 1)], 'datagrams'),
    (4, [], 'layers'), (40, [Layer(i + 1, 1) for i in range(MAX_LAYERS + 1)], 'layers'),
    (4, [Layer(0, 1)], 'thresholds'), (4, [Layer(5, 1)], 'thresholds'), (242, [Layer(122, 1)], 'thresholds'),
    (4, [Layer(2, 1), Layer(2, 1)], 'thresholds'), (4, [Layer(3, 1), Layer(2, 1)], 'thresholds'),
    (4, [Layer(1, 0)], 'thresholds'), (4, [Layer(1, -3)], 'thresholds'),
    (4080, [Layer(1, 65535)], 'bytes')])
def test_contradictory_plans(count, layers, message) -> None:
    with pytest.raises(ValueError, match=message):
        Restorer(count, layers)
    with pytest.raises(ValueError, match=message):
        protect(b'x', Plan(count, layers))
