# SPDX-License-Identifier: BSD-3-Clause
"""make_streams: looks at what a running robot publishes, and writes a streams.yaml that sends it."""
import argparse
import re
import sys
import time
from typing import Any, Dict, List, Tuple

import rosgraph
import rospy
from genpy.message import get_message_class
from rospy import AnyMsg

from ..monitoring.sources import OWN_NODES, Graph, graph_of
from ..streams.proposal import IMAGES, Topic, propose, text_of
from ..streams.proposed_frames import ODOMETRY, Placed, Tree, proposed_frames
from ..udpros import rpc
from .any_type import read
from .check import TopicListener, service_type
from .rviz_displays import TF, TF_STATIC, TF_TYPES
from .terminal import fail, master_answers, run_node

OTHERS = ('/rosout', '/make_streams', '/record', '/rviz', '/rqt')
"""Beginnings of the names of nodes that are no part of a robot."""

LEFT_OUT = re.compile(r'/(get_loggers|set_logger_level|set_parameters|tf2_frames)$|^/rosout/')
"""Services that nodes have anyway."""

MAX_SERVICES = 30
"""That are asked for their type, each at its node; further ones are not proposed."""

OPERATORS_NODE = '/operator_receiver'
"""End of its name; what it listens to is what operators send."""


def is_robots(node: str) -> bool:
    """Whether a node is one of the robot's own."""
    return not node.startswith(OTHERS) and not node.endswith(OWN_NODES)


def topics_of(graph: Graph, seconds: float) -> Tuple[List[Topic], Dict[str, str]]:
    """What the robot publishes, listened to for a while, and its frames."""
    tree = Tree()
    published = {topic: graph.types[topic] for topic, nodes in sorted(graph.publishers.items())
                 if graph.types.get(topic, '*') != '*' and any(map(is_robots, nodes))
                 and not any(node.endswith(OPERATORS_NODE) for node in graph.subscribers.get(topic, ()))}
    listeners = {topic: _listener(topic, type_, tree) for topic, type_ in published.items()}
    time.sleep(seconds)
    found, placed = [], []
    for topic, listener in listeners.items():
        heard, last = listener.heard(), listener.last
        latched = last is not None and (last._connection_header or {}).get('latching') == '1'
        encoding = _text(published[topic], last, 'encoding') if published[topic] == IMAGES[0] else ''
        found.append(Topic(topic, published[topic], heard.rate, heard.size, latched, encoding,
                           get_message_class(published[topic]) is not None))
        child = _text(published[topic], last, 'child_frame_id') if published[topic] == ODOMETRY else ''
        placed.append(Placed(topic, published[topic], heard.frame or '', child))
    return found, proposed_frames(placed, tree)


def services_of(graph: Graph) -> Dict[str, str]:
    """{service: its type} of the robot's services."""
    names = [service for service, nodes in sorted(graph.services.items())
             if any(map(is_robots, nodes)) and not LEFT_OUT.search(service)]
    types = {name: service_type(name) for name in names[:MAX_SERVICES]}
    return {name: type_ for name, type_ in types.items() if type_}


def _listener(topic: str, type_: str, tree: Tree) -> TopicListener:
    """Listens to a topic; the tree gets its transforms."""
    class_ = get_message_class(type_)

    def add(message: Any) -> None:
        try:
            tree.add(read(message, class_).transforms, topic == TF_STATIC)
        except ValueError as error:
            rospy.logdebug('%s: %s', topic, error)
    if topic in TF and type_ in TF_TYPES and class_ is not None:
        return TopicListener(topic, class_, add)
    return TopicListener(topic, class_)


def _text(type_: str, last: Any, field: str) -> str:
    """A text in a message; empty: unknown."""
    if not isinstance(last, AnyMsg):
        return ''
    try:
        return str(getattr(read(last, get_message_class(type_)), field))
    except ValueError:
        return ''


def run(arguments: argparse.Namespace) -> int:
    """Print the proposal; returns the exit code."""
    if not master_answers():
        return fail('make_streams', 'no ROS master answers at %s' % rosgraph.get_master_uri())
    rospy.init_node('make_streams', anonymous=True, disable_signals=True, log_level=rospy.FATAL)
    master = rosgraph.get_master_uri()
    graph = graph_of(rpc.call(master, 'getSystemState'), rpc.call(master, 'getTopicTypes'))
    listened = {topic: graph.types.get(topic, '*') for topic, nodes in graph.subscribers.items()
                if any(map(is_robots, nodes)) and not any(map(is_robots, graph.publishers.get(topic, ())))}
    topics, frames = topics_of(graph, arguments.seconds)
    proposed = propose(topics, listened, graph.publishers, services_of(graph))
    print(text_of(proposed, frames, arguments.seconds), end='')
    print('make_streams: %d streams%s' % (
        sum(not stream.off for stream in proposed), '; others stand as comments' * any(
            stream.off for stream in proposed)), file=sys.stderr)
    return 0


def main() -> None:
    parser = argparse.ArgumentParser(
        prog='make_streams', description='Write a streams.yaml for what the running robot publishes; to be run on the '
        'robot.', epilog='rosrun smokebot_udp make_streams > my_streams.yaml')
    parser.add_argument('--seconds', type=float, default=5.0, help='how long to listen (default: %(default)s)')
    arguments = parser.parse_args(rospy.myargv(sys.argv)[1:])
    run_node(lambda: run(arguments))
