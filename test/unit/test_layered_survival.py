# SPDX-License-Identifier: BSD-3-Clause
"""How likely layers are restored: by hand, datagram by datagram, and by simulation."""
from typing import Optional

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.codecs.layered.pieces import parts_of
from smokebot_udp.codecs.layered.survival import SURE, arrivals, sure_count, survival


def test_arrivals_by_hand() -> None:
    one = arrivals(2, np.array([0.25]), np.array([0.75]))       # independent losses
    assert one[0] == pytest.approx([0.0625, 0.375, 0.5625])
    # lost half the time, and the next one shares its fate in three of four cases
    two = arrivals(2, np.array([0.5]), np.array([0.25]))
    assert two[0] == pytest.approx([0.375, 0.25, 0.375])
    assert arrivals(1, np.array([0.1]), np.array([0.2]))[0] == pytest.approx([0.1, 0.9])


@pytest.mark.parametrize('count', [3, 12, 71, 240])
@pytest.mark.parametrize('loss', [1e-4, 0.05, 0.5, 0.9])
@pytest.mark.parametrize('burst', [None, 1.5, 8.0, 40.0])
def test_arrivals_datagram_by_datagram(count, loss, burst) -> None:
    recovery = 1 - loss if burst is None else min(1 / burst, 1 - loss)
    failure = loss * recovery / (1 - loss)
    good, bad = np.zeros(count + 1), np.zeros(count + 1)
    good[0], bad[0] = 1 - loss, loss
    for _ in range(count):
        come = np.concatenate([[0], good[:-1]])
        good, bad = come * (1 - failure) + bad * recovery, come * failure + bad * (1 - recovery)
    assert arrivals(count, np.array([loss]), np.array([recovery]))[0] == pytest.approx(good + bad, abs=1e-9)


@pytest.mark.parametrize('threshold', [30, 120])
def test_survival_with_two_codes_by_simulation(threshold) -> None:
    count, loss = 480, 0.47 if threshold == 120 else 0.935
    came = np.random.RandomState(1).random_sample((4000, count)) >= loss
    if parts_of(threshold, count) == 1:
        restored = (came[:, :240] | came[:, 240:]).sum(axis=1) >= threshold
    else:
        restored = (came[:, ::2].sum(axis=1) >= threshold) & (came[:, 1::2].sum(axis=1) >= threshold)
    assert 0.2 < restored.mean() < 0.9
    assert survival(count, {loss: 1.0}, None)[threshold - 1] == pytest.approx(restored.mean(), abs=0.03)


@pytest.mark.parametrize('burst', [None, 8.0])
def test_copies_of_few_losses_are_certain(burst) -> None:
    light, heavy = (survival(720, {loss: 1.0}, burst) for loss in (0.3, 0.9))
    assert (light[:80] == 1).all() and light[200] < 0.5
    assert heavy[0] > 0.99 and heavy[79] < 0.1


def test_survival_mixes_losses_and_falls() -> None:
    mixed = survival(20, {0.1: 0.75, 0.5: 0.25}, None)
    assert mixed == pytest.approx(0.75 * survival(20, {0.1: 1.0}, None) + 0.25 * survival(20, {0.5: 1.0}, None))
    assert (np.diff(mixed) <= 0).all() and mixed[0] <= 1 and len(mixed) == 20


@pytest.mark.parametrize('loss, burst, count', [
    (0.0, None, 1), (0.02, None, 1), (0.1, None, 2), (0.2, None, 3), (0.5, None, 6), (0.66, None, 10), (0.9, None, 38),
    (0.5, 2.0, 6), (0.5, 10.0, 32), (0.9, 5.0, 38), (0.9, 20.0, 76)])
def test_of_how_many_datagrams_one_comes_nearly_always(loss: float, burst: Optional[float], count: int) -> None:
    assert sure_count(loss, burst) == count


@given(st.floats(0.0, 0.97), st.none() | st.floats(1.0, 30.0))
def test_no_fewer_datagrams_would_do(loss: float, burst: Optional[float]) -> None:
    count = sure_count(loss, burst)
    if count <= 200:    # of one code
        assert survival(count, {loss: 1.0}, burst)[0] >= SURE - 1e-6
        assert count == 1 or survival(count - 1, {loss: 1.0}, burst)[0] <= SURE + 1e-6
