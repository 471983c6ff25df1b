# SPDX-License-Identifier: BSD-3-Clause
"""Memory that a node keeps: what it frees for a while, and uses again, is no growth; what stays is."""
import numpy as np
import pytest

pytest.importorskip('psutil')

from evaluation.kept_memory import QUICK_KEPT, most_kept  # noqa: E402
from smokebot_udp.nodes.garbage import PERIOD  # noqa: E402

TIMES = np.arange(0.0, 60.0, 0.2)


def test_what_is_returned_each_period_does_not_count() -> None:
    assert most_kept(TIMES.tolist(), (100 + 30 * (TIMES % PERIOD) / PERIOD).tolist(), QUICK_KEPT) == 100


def test_what_is_kept_for_a_while_counts_also_where_it_is_freed_later() -> None:
    sizes = 100 + 20 * ((TIMES > 10) & (TIMES < 15 + QUICK_KEPT)) + 30 * (TIMES % PERIOD) / PERIOD
    assert most_kept(TIMES.tolist(), sizes.tolist(), QUICK_KEPT) >= 120


def test_few_samples() -> None:
    assert most_kept([0.0, 1.0], [7.0, 5.0], QUICK_KEPT) == 5.0
