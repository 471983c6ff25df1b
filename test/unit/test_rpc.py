# SPDX-License-Identifier: BSD-3-Clause
"""TCP connections that race, against real sockets."""
import contextlib
import gzip
import http.client
import resource
import socket
import socketserver
import threading
import xmlrpc.client
from typing import Any
from xmlrpc.server import SimpleXMLRPCRequestHandler, SimpleXMLRPCServer

import pytest
from polling import WAIT, wait_for

from smokebot_udp.udpros import rpc


@pytest.fixture
def server() -> Any:
    with socket.create_server(('127.0.0.1', 0), backlog=0) as listening:
        yield listening


@pytest.fixture
def attempts(monkeypatch) -> Any:
    """The sockets that connect makes."""
    made, real = [], socket.socket

    class Noted(real):
        def __init__(self, *args, **kwargs) -> None:
            super().__init__(*args, **kwargs)
            if kwargs.get('fileno') is None:
                made.append(self)

    monkeypatch.setattr(rpc.socket, 'socket', Noted)
    return made


@contextlib.contextmanager
def full(listening) -> Any:
    """A context in which the kernel drops every attempt to connect, as a bad link does."""
    with contextlib.ExitStack() as waiting:
        for _ in range(2):
            one = waiting.enter_context(socket.socket())
            one.setblocking(False)
            one.connect_ex(listening.getsockname())
        yield


def test_on_a_good_link_the_first_attempt_connects(server, attempts) -> None:
    with rpc.create_connection(server.getsockname(), timeout=5) as connection:
        assert connection.gettimeout() == 5
        accepted, _ = server.accept()
        with accepted:
            connection.sendall(b'hello')
            assert accepted.recv(5) == b'hello'
    assert len(attempts) == 1


def test_packets_are_short_in_both_directions(server) -> None:
    """Where a path drops long ones without a word, calls go on."""
    with rpc.create_connection(server.getsockname(), timeout=5) as connection:
        accepted, _ = server.accept()
        with accepted:
            for one in (connection, accepted):
                assert one.getsockopt(socket.IPPROTO_TCP, socket.TCP_MAXSEG) <= rpc.MAX_SEGMENT


def test_an_attempt_without_answer_is_raced_by_others_and_all_are_closed(server, attempts) -> None:
    with full(server):
        del attempts[:]
        with pytest.raises(socket.timeout):
            rpc.create_connection(server.getsockname(), timeout=1.0)
    assert len(attempts) > 1
    assert all(attempt.fileno() == -1 for attempt in attempts)


def test_the_first_that_connects_is_returned_and_the_others_are_closed(server, attempts) -> None:
    accepted = []

    def make_room() -> None:
        accepted.extend(server.accept()[0] for _ in range(3))

    with full(server):
        del attempts[:]
        room = threading.Timer(0.5, make_room)
        room.start()
        with rpc.create_connection(server.getsockname(), timeout=20) as connection:
            assert connection.getpeername() == server.getsockname()
        room.join()
    assert all(attempt.fileno() == -1 for attempt in attempts)
    for one in accepted:
        one.close()


def test_all_http_of_a_process_may_connect_so(server, attempts, monkeypatch) -> None:
    monkeypatch.setattr(socket, 'create_connection', None)     # to be put back afterwards
    rpc.race_all_connections()
    connection = http.client.HTTPConnection(*server.getsockname())
    connection.connect()
    assert connection.sock.gettimeout() == socket.getdefaulttimeout()
    connection.close()
    assert len(attempts) == 1


def test_a_refusal_is_raised_at_once() -> None:
    with socket.create_server(('127.0.0.1', 0)) as closed:
        address = closed.getsockname()
    with pytest.raises(ConnectionRefusedError):
        rpc.create_connection(address, timeout=60)


def test_of_several_addresses_one_that_answers_is_used(server, monkeypatch) -> None:
    with socket.create_server(('127.0.0.1', 0)) as closed:
        refusing = closed.getsockname()
    monkeypatch.setattr(rpc.socket, 'getaddrinfo', lambda *args, **kwargs: [
        (socket.AF_INET, socket.SOCK_STREAM, 6, '', address) for address in (refusing, server.getsockname())])
    with rpc.create_connection(('two', 1), timeout=20) as connection:
        assert connection.getpeername() == server.getsockname()


def test_an_unreachable_network_is_raised(monkeypatch) -> None:
    monkeypatch.setattr(rpc.socket, 'getaddrinfo', lambda *args, **kwargs: [
        (socket.AF_INET, socket.SOCK_STREAM, 6, '', ('255.255.255.255', 1))])
    with pytest.raises(OSError, match='unreachable|denied'):
        rpc.create_connection(('nowhere', 1), timeout=20)


def test_a_call_connects_so_and_nuls_are_ignored() -> None:
    with SimpleXMLRPCServer(('127.0.0.1', 0), logRequests=False) as server:
        server.register_function(lambda caller: [1, '', caller], 'getPid')
        server._marshaled_dispatch = lambda *args: SimpleXMLRPCServer._marshaled_dispatch(server, *args) + b'\0'
        threading.Thread(target=server.serve_forever, daemon=True).start()
        proxy = xmlrpc.client.ServerProxy('http://127.0.0.1:%d' % server.server_address[1], transport=rpc.Transport())
        with proxy:
            assert proxy.getPid('/me') == [1, '', '/me']
        server.shutdown()


def test_long_lists_to_and_from_the_master_are_compressed() -> None:
    with SimpleXMLRPCServer(('127.0.0.1', 0), logRequests=False) as server:
        encodings = []

        class Handler(server.RequestHandlerClass):
            def do_POST(self) -> None:
                encodings.append(self.headers.get('Content-Encoding'))
                super().do_POST()

            def send_header(self, name, value) -> None:
                if name == 'Content-Encoding':
                    encodings.append(value)
                super().send_header(name, value)
        server.RequestHandlerClass = Handler
        server.register_function(lambda topics: topics, 'echo')
        threading.Thread(target=server.serve_forever, daemon=True).start()
        uri = 'http://127.0.0.1:%d' % server.server_address[1]
        topics = ['/operator/topic/%d' % i for i in range(100)]
        with xmlrpc.client.ServerProxy(uri, transport=rpc.MasterTransport()) as master:
            assert master.echo(topics) == topics
        server.shutdown()
    assert encodings == ['gzip', 'gzip']


class KeepingHandler(SimpleXMLRPCRequestHandler):
    protocol_version = 'HTTP/1.1'       # as the master's: the connection is kept


@contextlib.contextmanager
def api(address) -> Any:
    """A context with an XML-RPC server; yields its address."""
    class Server(socketserver.ThreadingMixIn, SimpleXMLRPCServer):
        daemon_threads = True
        allow_reuse_address = True

        def process_request(self, request, client_address) -> None:
            requests.append(request)
            super().process_request(request, client_address)

    requests = []
    with Server(address, KeepingHandler, logRequests=False) as served:
        served.register_function(lambda caller: (1, '', 7), 'getPid')
        served.register_function(lambda caller: (-1, 'no', ''), 'lookupNode')
        threading.Thread(target=served.serve_forever, args=(0.01,), daemon=True).start()
        yield served.server_address
        served.shutdown()
        for request in requests:
            with contextlib.suppress(OSError):
                request.shutdown(socket.SHUT_RDWR)


def test_a_session_keeps_its_connection_and_notices_a_new_one() -> None:
    with api(('127.0.0.1', 0)) as address:
        session = rpc.Session('http://%s:%d' % address)
        assert [session.call('getPid') for _ in range(3)] == 3 * [(1, '', 7)]
        assert session.call('lookupNode') == (-1, 'no', '')
        assert session.connections == 1
        with pytest.raises(rpc.Unreachable):
            session.call('noSuchMethod')
        before = session.connections
    with pytest.raises(rpc.Unreachable):
        session.call('getPid')
    with api(address):
        assert session.call('getPid')[2] == 7
        assert session.connections == before + 1


def test_a_session_notices_the_end_of_its_connection_without_a_call() -> None:
    session = None
    with api(('127.0.0.1', 0)) as address:
        session = rpc.Session('http://%s:%d' % address)
        assert not session.alive
        session.call('getPid')
        assert session.alive
    wait_for(lambda: not session.alive)
    session.close()
    assert not session.alive


def test_an_idle_connection_is_probed_by_the_kernel(monkeypatch) -> None:
    made = []
    connect = rpc.create_connection
    monkeypatch.setattr(rpc, 'create_connection', lambda *args: made.append(connect(*args)) or made[-1])
    with api(('127.0.0.1', 0)) as address:
        session = rpc.Session('http://%s:%d' % address)
        session.call('getPid')
        options = [made[0].getsockopt(socket.IPPROTO_TCP, option)
                   for option in (socket.TCP_KEEPIDLE, socket.TCP_KEEPINTVL)]
        assert made[0].getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
        assert sum(options) <= 3        # [s]
        session.close()


def test_calls_are_made_in_one() -> None:
    with SimpleXMLRPCServer(('127.0.0.1', 0), logRequests=False) as server:
        server.register_multicall_functions()
        server.register_function(lambda caller: (1, '', caller), 'good')
        server.register_function(lambda caller: (-1, 'no', ''), 'bad')
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        calls = [{'methodName': name, 'params': ['/me']} for name in ('good', 'bad', 'noSuchMethod', 'good')]
        uri = 'http://127.0.0.1:%d' % server.server_address[1]
        assert rpc.call_all(uri, calls, 5.0) == ['/me', None, None, '/me']
        server.shutdown()


@contextlib.contextmanager
def http_server(*answers: bytes) -> Any:
    """A context with a server that gives these answers, one to each connection; yields its URI."""
    with socket.create_server(('127.0.0.1', 0)) as listening:
        def serve() -> None:
            for answer in answers:
                connection, _ = listening.accept()
                with connection:
                    connection.recv(65536)
                    connection.sendall(answer)
        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield 'http://127.0.0.1:%d' % listening.getsockname()[1]
        thread.join(WAIT)


HEAD = b'HTTP/1.1 200 OK\r\nContent-Type: text/xml\r\nContent-Length: %d\r\n%s\r\n'
WHOLE = xmlrpc.client.dumps(((1, '', 7),), methodresponse=True).encode()
CUT = HEAD % (len(WHOLE), b'') + WHOLE[:50]


def test_an_answer_that_is_cut_off() -> None:
    """By the end of the master, or of the link: IncompleteRead, of http.client."""
    with http_server(CUT) as uri, pytest.raises(rpc.Unreachable):
        rpc.call(uri, 'getPid')
    with http_server(CUT) as uri, pytest.raises(rpc.Unreachable):
        rpc.call_all(uri, [{'methodName': 'getPid', 'params': []}], 5.0)


def test_a_call_of_rospys_is_repeated_until_the_master_answers() -> None:
    with http_server(CUT, CUT, HEAD % (len(WHOLE), b'') + WHOLE) as uri:
        assert rpc.repeated(lambda: xmlrpc.client.ServerProxy(uri).getPid()) == [1, '', 7]
    with pytest.raises(KeyError):
        rpc.repeated(lambda: {}['wrong'])


def test_an_answer_that_is_compressed_too_well_is_not_unpacked() -> None:
    bomb = gzip.compress(bytes(100 << 20))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    answer = HEAD % (len(bomb), b'Content-Encoding: gzip\r\n') + bomb
    with http_server(answer) as uri, pytest.raises(rpc.Unreachable):
        rpc.call(uri, 'getBusInfo')
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50 << 10       # [kB]
