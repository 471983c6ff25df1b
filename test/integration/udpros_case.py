# SPDX-License-Identifier: BSD-3-Clause
"""What the tests of UDPROS in one node share: its topics, and other nodes that they start, kill and pretend to be."""
import os
import pathlib
import signal
import subprocess
import sys
import unittest
import xmlrpc.client
from typing import Any, ClassVar

import rosgraph
import rospy
from std_msgs.msg import Header
from waiting import wait_for

from smokebot_udp import udpros
from smokebot_udp.udpros.negotiation import Request

HERE = pathlib.Path(__file__).resolve().parent


class UdprosCase(unittest.TestCase):
    """Tests in a node of their own."""
    NODE: ClassVar[str]

    @classmethod
    def setUpClass(cls) -> None:
        rospy.init_node(cls.NODE[1:])
        with udpros.registered_together():
            pass        # UDPROS is bound to the node

    def run_script(self, script, topic, name, *arguments) -> Any:
        process = start(script, topic, name, *arguments)
        self.addCleanup(end, process)
        return process

    def publisher(self, topic) -> Any:
        publisher = udpros.Publisher(topic, Header, queue_size=10)
        self.addCleanup(publisher.unregister)
        return publisher

    def published_until(self, publisher, condition, what) -> Any:
        def publish() -> Any:
            publisher.publish(Header(frame_id='x'))
            return condition()
        return wait_for(publish, 20, what)


def start(script, topic, name, *arguments) -> Any:
    return subprocess.Popen([sys.executable, str(HERE / script), topic, *arguments, '__name:=' + name],
                            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def end(process) -> None:
    if process.poll() is None:
        process.send_signal(signal.SIGCONT)
        process.kill()
        process.wait(10)


def open_files() -> Any:
    return len(os.listdir('/proc/self/fd'))


def request_topic(topic, caller, host, port, size=1472) -> Any:
    """A request to this node, as anybody could make it; returns the answer's code and text."""
    header = {'topic': topic, 'md5sum': Header._md5sum, 'type': Header._type, 'callerid': caller}
    with xmlrpc.client.ServerProxy(rospy.get_node_uri()) as proxy:
        return proxy.requestTopic(caller, topic, [Request(host, port, header, size).params()])[:2]


def rosgraph_uri(node) -> Any:
    try:
        return rosgraph.Master(rospy.get_name()).lookupNode(node)
    except rosgraph.MasterError:
        return None
