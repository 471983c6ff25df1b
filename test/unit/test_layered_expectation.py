# SPDX-License-Identifier: BSD-3-Clause
"""The expected quality of layered images is the mean of simulated ones; plans for reported losses are good."""
import needs_numba  # noqa: F401
import numpy as np
import pytest

from benchmarks.layered import Ladder, quality_table, reported
from evaluation.layered_quality import Air, Coded, psnr


@pytest.fixture(scope='module')
def coded() -> Coded:
    rows, columns = np.mgrid[:120, :160]
    random = np.random.RandomState(1)
    smooth = 120 + 60 * np.sin(rows / 9.0) * np.cos(columns / 7.0)
    return Coded((smooth + random.randint(-12, 12, rows.shape)).clip(0, 255).astype(np.uint8))


@pytest.mark.parametrize('loss, mixed', [(0.1, {0.1: 1.0}), (0.4, {0.1: 0.5, 0.5: 0.5})])
def test_expected_is_the_mean_of_simulated_losses(coded, loss, mixed) -> None:
    lossless, plan = coded.plan(6000, Air(mixed))
    random, shown = np.random.RandomState(2), []
    for _ in range(150):
        shown.append(psnr(coded.simulated(lossless, plan, random.random_sample(plan.count) >= loss)))
    expected = coded.expected(lossless, plan, Air({loss: 1.0}), psnr)
    # what came of the next layer without a gap is a bonus that is not counted
    assert expected - 1.0 < np.mean(shown) < expected + 2.0


def test_everything_arrives(coded) -> None:
    lossless, plan = coded.plan(60000, Air({0.0: 1.0}))
    assert lossless and coded.expected(lossless, plan, Air({0.0: 1.0}), psnr) == 60.0
    assert coded.simulated(lossless, plan, np.ones(plan.count, bool)) == 0.0


@pytest.mark.parametrize('loss, most', [(0.0, 2.0), (0.05, 1.2), (0.2, 1.2), (0.5, 1.2)])
def test_a_plan_for_the_reported_loss_is_nearly_as_good_as_one_that_knows(coded, loss, most) -> None:
    air = Air({loss: 1.0})
    known, believed = (coded.expected(*coded.plan(10000, one), air, psnr) for one in (air, reported(loss, 10, 1)))
    assert known - most < believed


def test_another_loss_than_reported(coded) -> None:
    air = Air({0.3: 1.0})
    knife_edge, robust = (coded.expected(*coded.plan(10000, one), air, psnr)
                          for one in (Air({0.05: 1.0}), reported(0.05, 10, 1)))
    assert robust > knife_edge + 1.5


def test_codings_of_fixed_sizes() -> None:
    ladder = Ladder([2000, 6000], [30.0, 40.0], 15.0)
    assert [ladder.best(size) for size in (1999, 2000, 5999, 6000)] == [15.0, 30.0, 30.0, 40.0]
    assert ladder.expected(9000, 0.0) == 40.0 and ladder.expected(9000, 0.999) < 16
    assert 30 < ladder.expected(9000, 0.1) < 40


def test_tables() -> None:
    cells = {'layered, loss known': {18: dict.fromkeys((0.0, 0.05, 0.1, 0.2, 0.5, 0.8, 0.9, 0.95), 40.0)}}
    assert quality_table(cells, {18: {0.2: 37.0}}, 1)[2:] == [
        '| 18 | layered, loss known | 40.0 | 40.0 | 40.0 | 40.0 | 40.0 | 40.0 | 40.0 | 40.0 |',
        '| 18 | goal, loss known |  |  |  | 37.0 |  |  |  |  |']
