# SPDX-License-Identifier: BSD-3-Clause
"""Robot and operator find each other over heavy loss, and each learns soon what the other wants."""
import pytest
from join_world import OPERATOR, ROBOT, JoinWorld, times_to_join

RUNS = 20


@pytest.mark.parametrize('loss', [0.5, 0.7, 0.8])
def test_layers_and_tiles_are_asked_for_within_seconds_of_the_join(loss: float) -> None:
    """Default streams and 40 relays; at 80 % loss each way what crosses once comes with 0.2."""
    after = sorted(after for _, after in times_to_join(RUNS, loss, 40, 60.0))
    assert after[RUNS - 2] < 2.0


def test_the_join_itself_takes_seconds_at_80_percent_loss() -> None:
    joins = sorted(join for join, _ in times_to_join(RUNS, 0.8, 0, 60.0))
    assert joins[RUNS // 2] < 3.0 and joins[RUNS - 2] < 8.0


def test_the_exchange_costs_little() -> None:
    """Without loss all is said once; the tables of before took 13 kB each time."""
    world = JoinWorld(1, 0.0, 40)
    assert world.run(5.0, world.wanted) is not None
    world.run(1.0, lambda: False)
    assert world.bytes_sent(ROBOT) < 2000
    begun = len(world.network.log)
    world.run(10.0, lambda: False)
    reports = 10 * 10 * (28 + 32 + 204)
    idle = world.bytes_sent(ROBOT, begun)
    assert idle < 10 * 1000 and world.bytes_sent(OPERATOR, begun) < reports + 10 * 1000
