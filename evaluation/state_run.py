# SPDX-License-Identifier: BSD-3-Clause
"""Small states through both nodes as shipped, over a link lab: which share of them comes, and how old."""
import contextlib
import pathlib
import sys
import tempfile
import time
from typing import Any, Dict, List

import numpy as np
import yaml

from . import TOP
from .listener import Heard, Listener
from .stack import Stack
from .state_source import CAMERA, RATE, STREAMS

RATE_LIMIT, QUEUE = 2e6, 0.2
"""Of the link [bit/s, s]."""

DELAY = 0.02
"""Each way [s]."""

LINK = '/robot_sender/link'

SETTLE = 4.0
"""Until reports name a loss [s]."""


class StateRun:
    """Both nodes and the sources, started; a context manager.

    :param log: of the nodes
    :raises LabError: as Lab
    """

    def __init__(self, seed: int, log: pathlib.Path) -> None:
        self._resources = contextlib.ExitStack()
        try:
            self._start(seed, log)
        except BaseException:
            self.close()
            raise

    def _start(self, seed: int, log: pathlib.Path) -> None:
        self.stack = self._resources.enter_context(Stack(seed, log=log))
        folder = pathlib.Path(self._resources.enter_context(tempfile.TemporaryDirectory()))
        streams = {name: {'type': 'relay', 'message_type': class_._type, 'robot_topic': topic,
                          'operator_topic': '/operator' + topic, 'rate': RATE}
                   for name, (topic, class_) in STREAMS.items()}
        streams['camera'] = {'type': 'image', 'robot_topic': CAMERA, 'operator_topic': '/operator' + CAMERA}
        file = folder / 'streams.yaml'
        file.write_text(yaml.safe_dump({'streams': streams}))
        self.stack.start('robot', sys.executable, '-m', 'evaluation.state_source', cwd=str(TOP))
        self._shown, self._sources = Listener(self.stack), Listener(self.stack, 'robot')
        self._shown.subscribe([['/operator' + topic, 'any', 'TCPROS'] for topic, _ in STREAMS.values()])
        self._sources.subscribe([
            *([topic, 'any', 'TCPROS'] for topic, _ in STREAMS.values()), [LINK, 'link', 'TCPROS']])
        for side, node in ('robot', 'robot_sender'), ('operator', 'operator_receiver'):
            self.stack.start_node(side, node, '_streams_file:=%s' % file)
        self._shown.first(['/operator' + topic for topic, _ in STREAMS.values()], 60.0)

    def measure(self, loss: float, seconds: float) -> List[Dict[str, Any]]:
        """A row for each stream, at this packet loss (0..1)."""
        self.stack.lab.set({'loss': loss, 'delay': DELAY, 'rate': RATE_LIMIT, 'queue': QUEUE})
        self._shown.during(SETTLE)
        begin = time.time()
        self._shown.during(seconds)
        end = time.time()
        self._shown.during(1.0)     # what comes later, as a repetition
        return [self._row(name, loss, begin, end) for name in STREAMS]

    def _row(self, name: str, loss: float, begin: float, end: float) -> Dict[str, Any]:
        topic = STREAMS[name][0]
        published = {one.stamp for one in self._sources.heard if one.topic == topic and begin <= (one.stamp or 0) < end}
        shown = [one for one in self._shown.heard if one.topic == '/operator' + topic and one.stamp in published]
        stamps = [one.stamp or 0.0 for one in shown]
        return {'stream': name, 'loss [%]': 100 * loss, 'published': len(published), 'shown': len(shown),
                'share [%]': 100 * len(shown) / max(1, len(published)), 'age p50 [ms]': _age(shown, 50),
                'age p95 [ms]': _age(shown, 95), 'link [Mbit/s]': self._rate(begin, end),
                'repeated': len(stamps) - len(set(stamps)),
                'in order': stamps == sorted(stamps)}

    def _rate(self, begin: float, end: float) -> float:
        """Of the link, as the robot estimates it."""
        return float(np.mean([one.amount['rate'] for one in self._sources.heard
                              if one.topic == LINK and begin <= one.arrival < end] or [np.nan]))

    def close(self) -> None:
        """End everything."""
        self._resources.close()

    def __enter__(self) -> 'StateRun':
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()


def _age(shown: List[Heard], percent: float) -> float:
    return 1e3 * float(np.percentile([one.age for one in shown], percent)) if shown else float('nan')
