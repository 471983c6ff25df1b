# SPDX-License-Identifier: BSD-3-Clause
"""The runner of the page for browsers."""
import asyncio
import threading
from types import SimpleNamespace
from typing import Any

import rospy

from smokebot_udp.nodes.opened import Opened
from smokebot_udp.web import node


def test_a_node_that_is_ended_while_it_starts_ends(monkeypatch: Any) -> None:
    """What is registered by on_shutdown while rospy runs what was registered before is lost."""
    closed = threading.Event()
    monkeypatch.setattr(rospy, 'on_shutdown', lambda function: None)
    monkeypatch.setattr(rospy.core, 'is_shutdown_requested', lambda: True)
    monkeypatch.setattr(node.udpros, 'Publisher', lambda *_, **__: SimpleNamespace(publish=lambda count: None))
    monkeypatch.setattr(node.garbage, 'collect_regularly', lambda: None)
    monkeypatch.setattr(node, 'stations_of', lambda *_: {})

    def run() -> None:
        loop, opened = asyncio.new_event_loop(), Opened()
        asyncio.set_event_loop(loop)
        opened.callback(closed.set)
        node.run({}, opened, loop)      # type: ignore[arg-type]
        loop.close()
    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(20)
    assert closed.is_set() and not thread.is_alive()
