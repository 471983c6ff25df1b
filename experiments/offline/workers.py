# SPDX-License-Identifier: BSD-3-Clause
"""Measures the independent parts of an experiment in two processes at once."""
import multiprocessing
import pathlib
import sys
from concurrent.futures import ProcessPoolExecutor
from typing import Callable, Iterator, Optional, Sequence, TypeVar

import smokebot_udp

from ..runner import Run

PROCESSES = 2

Part = TypeVar('Part')
Result = TypeVar('Result')


class Workers:
    """Processes that measure; they end with the context.

    :param run: whose progress is shown
    """

    def __init__(self, run: Run, processes: int = PROCESSES) -> None:
        self._run = run
        # processes begin with this path; catkin's package has put its sources first, where there are no messages
        sys.path.insert(0, str(pathlib.Path(smokebot_udp.__path__[0]).parent))
        # a forked process would inherit the locks of the threads of OpenCV and numba
        self._pool = ProcessPoolExecutor(processes, multiprocessing.get_context('spawn'))

    def __enter__(self) -> 'Workers':
        return self

    def __exit__(self, *exception: object) -> None:
        self._pool.shutdown()

    def each(self, measure: Callable[[Part], Result], parts: Sequence[Part],
             describe: Optional[Callable[[Part], str]] = None) -> Iterator[Result]:
        """measure(part) of each part, in their order.

        :param measure: a function of a module, or a partial of one; its results may not depend on earlier parts
        :param describe: as of Run.steps
        :raises Exception: what it raised; parts that were not begun are given up
        """
        results = self._pool.map(measure, parts)
        for _ in self._run.steps(parts, describe):
            yield next(results)
