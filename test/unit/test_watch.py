# SPDX-License-Identifier: BSD-3-Clause
"""How often a node looks after its topics: the watch's thread, and a master that knows the node."""
import socket
import socketserver
import threading
import time
import unittest.mock
from types import SimpleNamespace
from typing import Any, Iterator, List
from xmlrpc.server import SimpleXMLRPCRequestHandler, SimpleXMLRPCServer

import pytest
from polling import give_time, wait_for

from smokebot_udp.udpros import tcp_connections, watch

URI = 'http://here:1/'


class Handler(SimpleXMLRPCRequestHandler):
    protocol_version = 'HTTP/1.1'   # the connection stays open


class Master(socketserver.ThreadingMixIn, SimpleXMLRPCServer):
    daemon_threads, block_on_close = True, False

    def _dispatch(self, method: str, params: Any) -> Any:
        return 1, '', {'lookupNode': URI, 'getPid': 7}.get(method, 0)


@pytest.fixture
def master(monkeypatch: Any) -> Iterator[None]:
    with Master(('127.0.0.1', 0), Handler, logRequests=False) as server:
        monkeypatch.setenv('ROS_MASTER_URI', 'http://127.0.0.1:%d/' % server.server_address[1])
        threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
        yield
        server.shutdown()


@pytest.mark.usefixtures('master')
def test_the_watch_hurries_only_while_this_machine_has_lost_its_address() -> None:
    steps: List[float] = []
    registration: Any = SimpleNamespace(publisher_update=None, uri=URI)
    connector: Any = SimpleNamespace(upgrade=lambda impls, now: None, connect_tcp=None)
    watched = watch.Watch(connector, registration, lambda: steps.append(time.monotonic()))

    def gap() -> float:
        return steps[-1] - steps[-2]

    watched.start()
    try:
        wait_for(lambda: len(steps) > 1 and gap() >= 0.9 * watch.PERIOD)
        with unittest.mock.patch.object(watch, 'is_own', lambda address: False):
            wait_for(lambda: gap() < 0.5 * watch.PERIOD)
        wait_for(lambda: gap() >= 0.9 * watch.PERIOD)
    finally:
        watched.stop()


@pytest.mark.usefixtures('master')
def test_a_plain_subscription_is_connected_again_after_a_change_of_this_machines_address(monkeypatch: Any) -> None:
    topic: Any = SimpleNamespace(resolved_name='/cmd_vel', closed=False, connections=[])
    monkeypatch.setattr(watch, 'get_topic_manager', lambda: SimpleNamespace(
        subs={topic.resolved_name: topic}, get_subscriber_impl=lambda name: topic))
    made: List[Any] = []

    def connect(name: str, uri: str) -> None:
        connection = SimpleNamespace(name=name, endpoint_id=uri, socket=socket.socket(),
                                     close=topic.connections.clear)
        connection.socket.connect(server.getsockname())
        topic.connections.append(connection)
        made.append(connection.socket)

    connector: Any = SimpleNamespace(upgrade=lambda impls, now: None, connect_tcp=connect)
    registration: Any = SimpleNamespace(publisher_update=lambda name, uris: None, uri=URI)
    with socket.create_server(('127.0.0.1', 0)) as server:
        watched = watch.Watch(connector, registration, lambda: None)
        watched.publisher_update('/cmd_vel', ['http://publisher:1/'])
        connect('/cmd_vel', 'http://publisher:1/')
        watched.start()
        try:
            give_time(2 * watch.PERIOD)         # it works
            assert len(made) == 1
            with unittest.mock.patch.object(tcp_connections, 'is_own', lambda address: len(made) > 1):
                wait_for(lambda: len(made) == 2)
        finally:
            watched.stop()
            for connected in made:
                connected.close()
