# SPDX-License-Identifier: BSD-3-Clause
"""Parts of an experiment that are measured in two processes."""
import os
import pathlib
import time
from typing import Tuple

import pytest

pytest.importorskip('tqdm')

from experiments.offline.workers import Workers  # noqa: E402
from experiments.runner import Run  # noqa: E402


def measured(part: int) -> Tuple[int, int]:
    """The first parts take longest."""
    time.sleep(0.2 / (part + 1))
    return part * part, os.getpid()


def failing(part: int) -> int:
    if part == 1:
        raise ValueError('part %d' % part)
    return part


def imported(part: int) -> str:
    from smokebot_udp import msg  # the process finds it by itself
    return msg.__name__


def ending(part: int) -> None:
    os._exit(part)


@pytest.mark.parametrize('processes', (1, 2))
def test_results_come_in_the_order_of_the_parts(tmp_path: pathlib.Path, processes: int) -> None:
    with Workers(Run(tmp_path, True, 1), processes) as workers:
        for count in (8, 0, 3):
            results = list(workers.each(measured, range(count), str))
            assert [value for value, _ in results] == [part * part for part in range(count)]
            assert os.getpid() not in [process for _, process in results]


def test_the_processes_find_the_messages(tmp_path: pathlib.Path) -> None:
    with Workers(Run(tmp_path, True, 1)) as workers:
        assert list(workers.each(imported, [0])) == ['smokebot_udp.msg']


def test_an_error_comes_out(tmp_path: pathlib.Path) -> None:
    with Workers(Run(tmp_path, True, 1)) as workers:
        results = workers.each(failing, range(100))
        assert next(results) == 0
        with pytest.raises(ValueError, match='part 1'):
            list(results)


def test_so_does_the_end_of_a_process(tmp_path: pathlib.Path) -> None:
    with Workers(Run(tmp_path, True, 1)) as workers, pytest.raises(Exception, match='terminated abruptly'):
        list(workers.each(ending, range(3)))
