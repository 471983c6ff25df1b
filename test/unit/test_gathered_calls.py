# SPDX-License-Identifier: BSD-3-Clause
"""Calls that come together, to real XML-RPC servers."""
import contextlib
import socket
import socketserver
import threading
from typing import Any, Callable, Iterator, List, Sequence
from xmlrpc.server import SimpleXMLRPCRequestHandler, SimpleXMLRPCServer

import pytest

from smokebot_udp.udpros import rpc
from smokebot_udp.udpros.gathered_calls import MAX_TOGETHER, GatheredCalls
from smokebot_udp.udpros.negotiation import Refused


class Node(socketserver.ThreadingMixIn, SimpleXMLRPCServer):
    """A node's server, as rospy's: one thread for each connection."""
    daemon_threads = True

    def __init__(self, together: bool) -> None:
        self.sizes: List[int] = []
        """Bytes of each request."""
        node = self

        class Handler(SimpleXMLRPCRequestHandler):
            def do_POST(self) -> None:
                node.sizes.append(int(self.headers['Content-Length']))
                super().do_POST()
        super().__init__(('127.0.0.1', 0), Handler, logRequests=False)
        self.uri = 'http://127.0.0.1:%d/' % self.server_address[1]
        self.register_function(self._request, 'requestTopic')
        if together:
            self.register_multicall_functions()

    @staticmethod
    def _request(caller: str, topic: str) -> Any:
        if topic == '/unknown':
            return [0, 'not a publisher', 0]
        if topic == '/broken':
            raise RuntimeError('a bug')
        return [1, 'ready', 'port of ' + topic] if topic != '/odd' else 7


@contextlib.contextmanager
def serving(together: bool = True) -> Iterator[Node]:
    with Node(together) as node:
        thread = threading.Thread(target=node.serve_forever, args=(0.01,))
        thread.start()
        yield node
        node.shutdown()
        thread.join()


def outcomes(call: Callable[[str], Any], topics: Sequence[str]) -> List[Any]:
    """What call(topic) returns or raises, from a thread for each topic, all at once."""
    found: List[Any] = [None] * len(topics)
    begin = threading.Barrier(len(topics))

    def run(index: int) -> None:
        begin.wait()
        try:
            found[index] = call(topics[index])
        except Exception as error:
            found[index] = error
    threads = [threading.Thread(target=run, args=(index,)) for index in range(len(topics))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return found


@pytest.fixture(autouse=True)
def long_enough(monkeypatch: Any) -> None:
    """For the threads of a busy machine."""
    monkeypatch.setattr('smokebot_udp.udpros.gathered_calls.GATHERING_TIME', 0.5)


def test_calls_that_come_together_are_made_in_one_request() -> None:
    topics, calls = ['/topic%d' % i for i in range(17)], GatheredCalls()
    with serving() as node:
        found = outcomes(lambda topic: calls.call(node.uri, 'requestTopic', topic), topics)
    assert found == ['port of ' + topic for topic in topics]
    assert len(node.sizes) == 1


def test_one_that_fails_does_not_harm_the_others() -> None:
    calls = GatheredCalls()
    with serving() as node:
        good, unknown, broken, odd = outcomes(lambda topic: calls.call(node.uri, 'requestTopic', topic),
                                              ['/good', '/unknown', '/broken', '/odd'])
    assert good == 'port of /good'
    assert isinstance(unknown, Refused) and 'not a publisher' in str(unknown)
    assert isinstance(broken, rpc.Unreachable) and isinstance(odd, rpc.Unreachable)


def test_a_node_that_takes_single_calls_only_gets_these() -> None:
    calls = GatheredCalls()
    with serving(together=False) as node:
        good, unknown = outcomes(lambda topic: calls.call(node.uri, 'requestTopic', topic), ['/good', '/unknown'])
    assert good == 'port of /good' and isinstance(unknown, Refused)


def test_each_node_has_requests_of_its_own() -> None:
    calls = GatheredCalls()
    with serving() as one, serving() as other:
        uris = [one.uri, other.uri, one.uri, other.uri]
        assert outcomes(lambda index: calls.call(uris[int(index)], 'requestTopic', '/' + index), list('0123')) == [
            'port of /%d' % i for i in range(4)]
    assert len(one.sizes) == len(other.sizes) == 1


def test_one_request_is_not_longer_than_it_may_be() -> None:
    topics, calls = ['/topic%d' % i for i in range(MAX_TOGETHER + 1)], GatheredCalls()
    with serving() as node:
        found = outcomes(lambda topic: calls.call(node.uri, 'requestTopic', topic), topics)
    assert found == ['port of ' + topic for topic in topics]
    assert len(node.sizes) == 2 and max(node.sizes) > 5 * min(node.sizes)


def test_a_call_alone_is_a_plain_one() -> None:
    with serving(together=False) as node:
        assert GatheredCalls().call(node.uri, 'requestTopic', '/topic') == 'port of /topic'
        assert len(node.sizes) == 1


def test_all_callers_of_a_node_that_has_ended_are_told() -> None:
    with socket.create_server(('127.0.0.1', 0)) as closed:
        uri = 'http://127.0.0.1:%d/' % closed.getsockname()[1]
    calls = GatheredCalls()
    assert all(isinstance(one, rpc.Gone) for one in outcomes(
        lambda topic: calls.call(uri, 'requestTopic', topic), ['/a', '/b', '/c']))
