# SPDX-License-Identifier: BSD-3-Clause
"""Small states through both nodes as shipped, over a link lab: which share comes, how old, and what that costs."""
import bisect
import math
import pathlib
import sys
import tempfile
import time
from typing import Any, Dict, List

import numpy as np
import yaml

from smokebot_udp.streams.segments import wire_topic
from smokebot_udp.udpros.datagram import IP_UDP_HEADERS, OVERHEAD

from . import TOP
from .listener import Heard, Listener
from .rate_steps import queue_delay
from .stack import Stack
from .started import Started
from .state_source import CAMERA, RATE, STREAMS

RATE_LIMIT, DELAY = 2e6, 0.02
"""Rate of the link [bit/s], and its delay each way [s]."""

LINK_CONDITIONS = {'rate': RATE_LIMIT, 'delay': DELAY, 'queue': 0.2}
"""See link_lab."""

LINK = '/robot_sender/link'

SETTLE = 6.0
"""Time until reports name a loss, and the rate follows what is sent [s]."""


class StateRun(Started):
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
        folder = pathlib.Path(self.enter_context(tempfile.TemporaryDirectory()))
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
            *([topic, 'any', 'TCPROS'] for topic, _ in STREAMS.values()), [LINK, 'link', 'TCPROS'],
            *([wire_topic(name), 'repetition', 'TCPROS'] for name in STREAMS)])
        for side, node in ('robot', 'robot_sender'), ('operator', 'operator_receiver'):
            self.stack.start_node(side, node, '_streams_file:=%s' % file)
        self._shown.first(['/operator' + topic for topic, _ in STREAMS.values()], 60.0)

    def measure(self, loss: float, seconds: float, camera: bool = True) -> List[Dict[str, Any]]:
        """A row for each stream.

        :param loss: packet-loss ratio, 0..1
        :param camera: whether its images are sent, too
        """
        self.stack.lab.set({'loss': loss, **LINK_CONDITIONS})
        self.stack.set_parameter('/robot_sender/camera/enabled', camera)
        self._shown.during(SETTLE)
        begin, before = time.time(), self.stack.lab.counts()
        self._shown.during(seconds)
        end, after = time.time(), self.stack.lab.counts()
        self._shown.during(1.0)     # what comes later, as a repetition
        link = {'camera': camera, 'loss [%]': 100 * loss, **self._link(begin, end),
                'queue p50 [ms]': queue_delay(before, after, 0.5), 'queue p95 [ms]': queue_delay(before, after, 0.95),
                'used [%]': 100 * 8 * (after['robot']['carried'] - before['robot']['carried']) / (
                    (end - begin) * RATE_LIMIT)}
        return [{'stream': name, **self._row(name, begin, end), **link} for name in STREAMS]

    def _row(self, name: str, begin: float, end: float) -> Dict[str, Any]:
        topic = STREAMS[name][0]
        published = sorted({one.stamp for one in self._sources.heard
                            if one.topic == topic and one.stamp is not None and begin <= one.stamp < end})
        shown = [one for one in self._shown.heard if one.topic == '/operator' + topic and one.stamp in published]
        stamps = [one.stamp or 0.0 for one in shown]
        left = [one.arrival for one in self._segments(name, begin, end, False)]
        waits = [one - published[bisect.bisect(published, one) - 1] for one in left if one > published[0]]
        return {'published': len(published), 'shown': len(shown),
                'share [%]': 100 * len(shown) / max(1, len(published)),
                'age p50 [ms]': _quantile([one.age for one in shown], 50),
                'age p95 [ms]': _quantile([one.age for one in shown], 95), 'left p95 [ms]': _quantile(waits, 95),
                'repeated': len(stamps) - len(set(stamps)), 'in order': stamps == sorted(stamps)}

    def _link(self, begin: float, end: float) -> Dict[str, float]:
        """Stats of the link as the robot estimates it, and of what repetitions take of it."""
        told = [one.amount for one in self._sources.heard if one.topic == LINK and begin <= one.arrival < end]
        copies = sum(one.amount[2] + OVERHEAD + IP_UDP_HEADERS for name in STREAMS
                     for one in self._segments(name, begin, end, True))
        before = sum(one.amount[1] for name in STREAMS for one in self._segments(name, begin, end, False))
        return {'round trip p50 [ms]': _quantile([one['round_trip'] for one in told], 50),
                'link [Mbit/s]': float(np.mean([one['rate'] for one in told] or [np.nan])),
                'repetitions [kbit/s]': 8e-3 * (before + copies) / (end - begin),
                'repetitions [%]': 100 * 8 * (before + copies) / (end - begin) / RATE_LIMIT}

    def _segments(self, name: str, begin: float, end: float, copies: bool) -> List[Heard]:
        """The segments of a stream that left, of new messages, or copies of them."""
        found, seen = [], set()
        for one in self._sources.heard:
            if one.topic == wire_topic(name):
                if begin <= one.arrival < end and (one.amount[0] in seen) == copies:
                    found.append(one)
                seen.add(one.amount[0])
        return found


def _quantile(seconds: List[float], percent: float) -> float:
    """[ms]"""
    found = [one for one in seconds if not math.isnan(one)]
    return 1e3 * float(np.percentile(found, percent)) if found else float('nan')
