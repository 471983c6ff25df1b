# SPDX-License-Identifier: BSD-3-Clause
"""An operator joins a robot over heavy loss, again and again: both nodes as shipped, each with a master of its own."""
import pathlib
import re
import time
from typing import Any, Dict, Optional

import yaml

from smokebot_udp.link.packets import Kind

from . import TOP
from .listener import Heard, Listener
from .own_masters import PORT, OwnMasters
from .polling import wait_for
from .started import Started
from .tap import Tap

RELAYS = 40
"""Beside the streams of streams.yaml."""

HEAVY = {'loss': 0.8, 'delay': 0.02}
"""Each way."""

LAYERS, TILES, IMAGE = 'thermal/layers', 'map/tiles', '/operator/camera/image_raw'
"""Two parts of streams, which cross only when the robot knows that the operator wants them, and a topic."""

HELLO = 'HELLO'
PARTS = LAYERS, TILES

JOIN = re.compile(r'\[(\d+\.\d+)\]: /robot_sender\S* has joined from ')
"""What the operator's node logs."""

JOIN_TIMEOUT, TIMEOUT = 60.0, 30.0
"""For the join, and for all that follows it [s]."""

POLLING, DOWN_TIME = 0.05, 1.0
"""[s]"""


def with_relays(file: pathlib.Path, count: int = RELAYS) -> str:
    """Write the package's streams with further relays; returns the nodes' argument."""
    definitions = yaml.safe_load((TOP / 'config' / 'streams.yaml').read_text())
    for number in range(count):
        definitions['streams']['sensor_%d' % number] = {
            'type': 'relay', 'message_type': 'geometry_msgs/PoseStamped', 'robot_topic': '/sensor_%d' % number,
            'operator_topic': '/operator/sensor_%d' % number, 'rate': 1.0}
    file.write_text(yaml.safe_dump(definitions))
    return '_streams_file:=%s' % file


class Joins(Started):
    """Both sides; a context manager.

    :param folder: for files
    :param seed: of the link
    :raises LabError: as Lab
    """

    def __init__(self, folder: pathlib.Path, seed: int) -> None:
        super().__init__()
        self._log = folder / 'nodes.log'
        self._streams = with_relays(folder / 'streams.yaml')
        self.stack = self.enter_context(OwnMasters(seed, self._log))
        with self.starting():
            self._start()

    def _start(self) -> None:
        self.stack.start_node('robot', 'simulated_robot', '_width:=320', '_height:=240')
        self._listener = Listener(self.stack)
        self._listener.subscribe([['/diagnostics', 'parts', 'TCPROS'], [IMAGE, 'any', 'TCPROS']])
        self._tap = Tap(self.stack, PORT)
        self.stack.lab.set(HEAVY)
        self.stack.start_sender(self._streams)
        self.stack.wait_for_port()

    def join(self) -> Dict[str, Optional[float]]:
        """Start the operator's node and end it again: {HELLO, LAYERS, TILES, IMAGE: [s] after its join, None: never}.

        HELLO is its first datagram. What is counted in diagnostics is up to a second late: they come once a second.

        :raises RuntimeError: where it does not join
        """
        begun, logged, count = time.time(), self._log.stat().st_size, len(self._listener.heard)
        node = self.stack.start_receiver(self._streams)
        joined = wait_for(lambda: JOIN.search(self._written(logged)), JOIN_TIMEOUT, POLLING)
        if joined is None:
            raise RuntimeError('the operator does not join: see nodes.log')
        since = float(joined.group(1))
        wait_for(lambda: len(self._seen(count)) == 1 + len(PARTS), TIMEOUT, POLLING)
        found = {HELLO: self._tap.first(Kind.HELLO, begun).time, **self._seen(count)}
        self.stack.end(node)
        time.sleep(DOWN_TIME)
        return {name: round(found[name] - since, 2) if name in found else None for name in (HELLO, *PARTS, IMAGE)}

    def _written(self, since: int) -> str:
        return self._log.read_bytes()[since:].decode(errors='replace')

    def _seen(self, count: int) -> Dict[str, float]:
        """{name: when it was seen for the first time, of what was heard from an index on (time.time())}"""
        def names(heard: Heard) -> Any:
            return [heard.topic] if heard.topic == IMAGE else [name for name in PARTS if heard.amount.get(name)]
        return {name: heard.arrival for heard in self._listener.heard[count:][::-1] for name in names(heard)}
