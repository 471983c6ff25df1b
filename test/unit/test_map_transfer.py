# SPDX-License-Identifier: BSD-3-Clause
"""The map experiment: transfers by hand, and the real encoder and assembler over an emulated link."""
import math
import pathlib
import sys

import needs_numba  # noqa: F401
import numpy as np
import pytest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
from evaluation.map_transfer import DELAY, FRAGMENT, MapTransfer, fragments  # noqa: E402
from evaluation.maps import costs, simulated, sizes  # noqa: E402

ON_AIR = FRAGMENT + 12 + 28


def test_fragments_without_loss_take_the_time_of_their_bytes() -> None:
    outcome = fragments(3 * FRAGMENT + 1, 1e6, 0.0, 1, 10.0, whole=True)
    assert outcome.sent == 4 * ON_AIR
    assert outcome.complete == pytest.approx(4 * ON_AIR * 8 / 1e6 + DELAY)


def test_fragments_of_any_rounds_complete_each_other() -> None:
    rounds = [fragments(30 * FRAGMENT, 1e6, 0.5, 1, 20.0, whole) for whole in (False, True)]
    assert rounds[0].complete < 5.0 and math.isinf(rounds[1].complete)


def test_a_map_crosses_without_loss_and_is_not_repeated() -> None:
    cells = simulated()
    transfer = MapTransfer('tiles', 1e6, 0.0, 1)
    outcome = transfer.show(cells, 5.0)
    assert outcome.complete < 0.5 and outcome.sent < 5000
    transfer.settle(3.0)
    assert transfer.settle(5.0) < 5000


def test_the_interleaved_map_takes_longer() -> None:
    cells = simulated()[:100, :100]
    tiles, interleaved = (MapTransfer(coding, 1e6, 0.3, 2).show(cells, 30.0) for coding in ('tiles', 'interleaved'))
    assert tiles.complete < interleaved.complete


def test_costs_fall_from_obstacles() -> None:
    cells = np.full((1, 40), -1, np.int8)
    cells[0, 20:25] = 0
    cells[0, 20] = 100
    assert costs(cells)[0, 19:26].tolist() == [99, 100, 99, 99, 99, 98, 84]
    assert costs(cells)[0, 0] == -1


def test_sizes_of_a_map() -> None:
    found = sizes(simulated())
    assert found.tiles < 0.7 * found.zlib and found.factor == 1 and found.datagrams == 2
