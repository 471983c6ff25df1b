# SPDX-License-Identifier: BSD-3-Clause
"""The start of a node while the master restarts, and its end while it starts: a process, and a master that cuts its
first answers off, or interrupts it."""
import collections
import os
import signal
import subprocess
import sys
import threading
import time
from typing import Any, Counter, Iterator, List, Sequence, Tuple
from xmlrpc.server import SimpleXMLRPCRequestHandler, SimpleXMLRPCServer

import pytest

NODE = """
import sys
import rospy
from smokebot_udp import udpros
{init}('starting')
print('started', rospy.get_time() > 0, flush=True)
rospy.signal_shutdown('the test has ended')
"""

ENDED = """
import rospy
from smokebot_udp import udpros
udpros.init_node('starting')
rospy.signal_shutdown('new node registered with same name')
try:
    udpros.Publisher('chatter', rospy.AnyMsg)
except rospy.ROSInterruptException as error:
    print(error, flush=True)
"""

INTERRUPTED = """
import os
import rospy
from smokebot_udp import udpros
udpros.init_node('starting')
rospy.set_param('~pid', os.getpid())
rospy.spin()
print('ended', flush=True)
"""

EARLY = """
import os
import sys
from smokebot_udp import udpros
sys.argv.append('_pid:=%d' % os.getpid())
try:
    udpros.init_node('starting')
finally:
    print('ended', flush=True)
"""

LATE = """
import os
import signal
import sys
import time
import rospy
from smokebot_udp import udpros
os.dup2(1, 2)       # what is red
udpros.init_node('starting')
if {interrupted}:
    os.kill(os.getpid(), signal.SIGINT)
    while not rospy.is_shutdown():
        time.sleep(0.01)
raise rospy.{error}('the node is ending')
"""

ENDING = """
import threading
import rospy
from smokebot_udp import udpros
udpros.init_node('starting')
begun, goes_on = threading.Event(), threading.Event()
rospy.on_shutdown(lambda: (begun.set(), goes_on.wait(10)))
threading.Thread(target=rospy.signal_shutdown, args=('the test ends it',)).start()
begun.wait(10)
threading.Timer(0.3, goes_on.set).start()
{register}(lambda: print('closed', flush=True))
"""

ENDED_TWICE = """
import rospy
from smokebot_udp import udpros
udpros.init_node('starting')
udpros.on_end(lambda: print('first', flush=True))
rospy.signal_shutdown('the test ends it')
udpros.on_end(lambda: print('second', flush=True))
"""

CUT = b'HTTP/1.1 200 OK\r\nContent-Type: text/xml\r\nContent-Length: 100\r\n\r\n<?xml'

PAUSE = 0.5
"""For a handler of a signal to be called [s]."""


class Server(SimpleXMLRPCServer):
    """A master that answers these methods only from the second time on."""
    weak: Sequence[str] = ('setParam', 'getParam', 'registerPublisher')
    interrupts = signal.SIGINT

    def __init__(self) -> None:
        super().__init__(('127.0.0.1', 0), Handler, logRequests=False)
        self.asked: Counter[str] = collections.Counter()
        self.left: List[str] = []       # topics that were unregistered

    def _dispatch(self, method: str, params: Tuple[Any, ...]) -> Any:
        if method == 'setParam' and params[1].endswith('/pid'):
            os.kill(params[2], self.interrupts)     # it waits for the answer
            time.sleep(PAUSE)
        if method == 'unregisterPublisher':
            self.left.append(params[1])
        if method == 'system.multicall':
            return [[self._dispatch(one['methodName'], one['params'])] for one in params[0]]
        return 1, '', [] if method.startswith('register') else 0


class Handler(SimpleXMLRPCRequestHandler):

    def do_POST(self) -> None:
        server: Any = self.server
        length = int(self.headers['Content-Length'])
        body = self.rfile.read(length)
        method = body.split(b'<methodName>')[1].split(b'<')[0].decode()
        server.asked[method] += 1
        if method in server.weak and server.asked[method] == 1:
            self.wfile.write(CUT)
            self.close_connection = True
            return
        answer = server._marshaled_dispatch(body)
        self.send_response(200)
        self.send_header('Content-Length', str(len(answer)))
        self.end_headers()
        self.wfile.write(answer)


@pytest.fixture
def master() -> Iterator[Server]:
    with Server() as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
        thread.start()
        yield server
        server.shutdown()


def output(master: Server, program: str) -> str:
    """What a node prints that is started at this master."""
    environment = {**os.environ, 'ROS_MASTER_URI': 'http://127.0.0.1:%d' % master.server_address[1],
                   'ROS_HOSTNAME': '127.0.0.1'}
    return subprocess.run([sys.executable, '-c', program, '_private:=7'], env=environment, timeout=60,
                          stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True).stdout


def test_a_node_starts_while_the_master_restarts(master: Server) -> None:
    assert output(master, NODE.format(init='udpros.init_node')) == 'started True\n'
    assert master.asked['setParam'] == 2


def test_rospys_own_start_fails_then(master: Server) -> None:
    """Otherwise this module would not be needed any more."""
    assert output(master, NODE.format(init='rospy.init_node')) == ''


def test_a_node_that_the_master_ends_while_it_starts_says_so(master: Server) -> None:
    assert output(master, ENDED) == 'the node is ending\n'


def test_what_a_node_does_at_its_end_is_done_where_it_is_ended_while_it_starts(master: Server) -> None:
    master.weak = ()
    assert output(master, ENDING.format(register='udpros.on_end')) == 'closed\n'
    assert output(master, ENDED_TWICE) == 'first\nsecond\n'


def test_rospy_forgets_it(master: Server) -> None:
    """Otherwise udpros.on_end would not be needed any more."""
    master.weak = ()
    assert output(master, ENDING.format(register='rospy.on_shutdown')) == ''


@pytest.mark.parametrize('interrupted, error, told', [
    (True, 'ROSInterruptException', False), (True, 'ROSInitException', False),
    (False, 'ROSInterruptException', True), (True, 'ROSException', True)])
def test_a_node_that_is_interrupted_while_it_starts_prints_no_traceback(master: Server, interrupted: bool, error: str,
                                                                       told: bool) -> None:
    printed = output(master, LATE.format(interrupted=interrupted, error=error))
    assert ('Traceback' in printed) == told, printed


@pytest.mark.parametrize('program', [EARLY, INTERRUPTED])
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_node_ends_that_is_interrupted_while_it_calls_the_master(master: Server, number: signal.Signals,
                                                                   program: str) -> None:
    """It unregisters, too. rospy's own handler would wait for the lock of the call that it has interrupted."""
    master.weak, master.interrupts = (), number
    assert output(master, program) == 'ended\n'
    assert program == EARLY or '/rosout' in master.left     # it registers nothing before its parameters
