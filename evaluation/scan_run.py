# SPDX-License-Identifier: BSD-3-Clause
"""Scans of 1081 ranges beside all other streams, through both nodes as shipped, over a link lab."""
import pathlib
import sys
import time
from typing import Any, Dict, List

import numpy as np

from . import TOP
from .listener import Listener
from .scan_source import SCAN
from .stack import Stack
from .started import Started
from .state_run import LINK_CONDITIONS

SHOWN = '/operator' + SCAN
SETTLE = 6.0
"""Until the streams have their parts of the link [s]."""


class ScanRun(Started):
    """Both nodes and the sources, started; a context manager.

    :param log: of the nodes
    :raises LabError: as Lab
    """

    def __init__(self, seed: int, log: pathlib.Path) -> None:
        super().__init__()
        with self.starting():
            self._start(seed, log)

    def _start(self, seed: int, log: pathlib.Path) -> None:
        self.stack = self.enter_context(Stack(seed, log=log))
        self.stack.start('robot', sys.executable, '-m', 'evaluation.scan_source', cwd=str(TOP))
        self.stack.start_node('robot', 'simulated_robot', '_scan_rate:=0')
        self._shown = Listener(self.stack)
        self._shown.subscribe([[SHOWN, 'ranges', 'TCPROS']])
        streams = '_streams_file:=%s' % (TOP / 'config' / 'streams.yaml')
        self.stack.start_sender(streams)
        self.stack.start_receiver(streams)
        if not self._shown.first([SHOWN], 60.0):
            raise RuntimeError('no scan arrives')

    def measure(self, loss: float, exact: bool, seconds: float) -> Dict[str, Any]:
        """A row.

        :param loss: packet-loss ratio, 0..1
        :param exact: as the setting of scan streams
        """
        self.stack.lab.set({'loss': loss, **LINK_CONDITIONS})
        self.stack.set_parameter('/robot_sender/scan/exact', exact)
        self._shown.during(SETTLE)
        begun = time.monotonic()
        heard = self._shown.during(seconds)
        duration = time.monotonic() - begun
        shares: List[float] = [one.amount for one in heard]
        ages = [1e3 * one.age for one in heard]
        return {'exact': exact, 'loss [%]': 100 * loss, 'come [Hz]': len(heard) / duration,
                'whole [%]': 100 * float(np.mean([share == 1 for share in shares])),
                'ranges [%]': 100 * float(np.mean(shares)), 'age p50 [ms]': float(np.percentile(ages, 50)),
                'age p95 [ms]': float(np.percentile(ages, 95)), 'seconds': duration}
