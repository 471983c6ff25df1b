# SPDX-License-Identifier: BSD-3-Clause
"""The runner of the page for browsers."""
import asyncio
import threading
from types import SimpleNamespace
from typing import Any

import rospy

from smokebot_udp.web import node


def test_a_node_that_is_ended_while_it_starts_ends(monkeypatch: Any) -> None:
    closed = threading.Event()
    monkeypatch.setattr(rospy, 'on_shutdown', lambda function: None)
    monkeypatch.setattr(rospy.core, 'is_shutdown_requested', lambda: True)
    monkeypatch.setattr(node.udpros, 'Publisher', lambda *_, **__: SimpleNamespace(publish=lambda count: None))
    monkeypatch.setattr(node.garbage, 'collect_regularly', lambda: None)

    def stations_of(_: Any, opened: Any, came: Any) -> Any:
        opened.callback(closed.set)
        return {}
    monkeypatch.setattr(node, 'stations_of', stations_of)

    def run() -> None:
        loop = asyncio.new_event_loop()
        asyncio.set_event_loop(loop)
        node.run({}, loop)      # type: ignore[arg-type]
        loop.close()
    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(20)
    assert closed.is_set() and not thread.is_alive()
