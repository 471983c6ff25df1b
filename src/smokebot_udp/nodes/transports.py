# SPDX-License-Identifier: BSD-3-Clause
"""Chooses what carries the streams: UDPROS over a shared master, or a link between two masters over one UDP port.

This is the only place that knows which transports there are.
"""
import getpass
import os
import socket
import sys
import time
import urllib.parse
from typing import Any, Callable, List, Optional, Set, Tuple

import rosgraph
import rospy

from .. import traffic
from ..limited_log import ERROR_PERIOD
from ..link.keys import DEFAULT_KEY_FILE, KeyFile, copy_command, make_key
from ..link.robot_paths import MAX_PATHS
from ..link.transport import Datagrams, LinkTransport, OperatorTransport, RobotTransport
from ..transport import Transport
from ..udpros.endpoints import addresses_of, is_own
from ..udpros.transport import UdprosTransport
from .common import Parameters
from .logging import log_error

RETRY_PERIOD = 5.0
"""Time between attempts to start a transport [s]."""

ROBOT = '/robot_sender'
"""As robot.launch names it."""

FOREIGN = ('ROS_MASTER_URI is %s, %s, while robot:=%s is for a desk with a master of its own: now all its nodes '
           'need that one over the network; unset ROS_MASTER_URI and start the desk again')
"""What is wrong with the desk's master."""

NO_KEY = ('this desk has no key of the robot, %s: run the command here that robot.launch shows on the robot, or, with '
          'its user, %s')
"""What is wrong at a desk without a key."""


def robot_transport(parameters: Parameters) -> Transport:
    """The robot's transport; it waits until it can be started. A key that is missing is made.

    :param parameters: of ROBOT_SENDER
    """
    port, size = parameters['link_port'], parameters['max_datagram_size']
    tos_mask = traffic.mask(parameters['dscp'], parameters['ecn'])
    if not port and not parameters['key_file']:
        return UdprosTransport(size, tos_mask=tos_mask)
    path = _key_path(parameters)

    def listen() -> Transport:
        _check_link(port, 'link_port')
        is_new = not os.path.lexists(path)
        if is_new:
            make_key(path)
        key = KeyFile(path, log_error('', ERROR_PERIOD))
        try:
            transport = RobotTransport(port, key.key, datagrams=Datagrams(size, tos_mask=tos_mask),
                                       renewed=key.renewed, report=log_error('', ERROR_PERIOD))
        except OSError as error:
            raise ValueError('UDP port %d cannot be used: %s' % (port, error.strerror)) from None
        rospy.loginfo('%s %s; on a desk that lacks it, run: %s', 'the link has a new key,' if is_new else
                      'the key of the link is', path, copy_command(_for_scp(path), DEFAULT_KEY_FILE))
        return _remarked(transport)
    return _patiently('the link', listen)


def operator_transport(parameters: Parameters) -> Transport:
    """The operator's transport; it waits until it can be started.

    :param parameters: of OPERATOR_RECEIVER
    """
    robot, size, buffer = (parameters[name] for name in ('robot', 'max_datagram_size', 'receive_buffer'))
    tos_mask = traffic.mask(parameters['dscp'], False)
    if not robot and not parameters['key_file']:
        return UdprosTransport(size, buffer, tos_mask)
    path = _key_path(parameters)

    def connect() -> Transport:
        _check_link(robot, 'robot')
        addresses = addresses_in(robot)
        if not os.path.lexists(path):
            source = 'USER@%s:%s' % (addresses[0][0].partition('%')[0], DEFAULT_KEY_FILE[2:])
            raise ValueError(NO_KEY % (path, copy_command(source, path)))
        key = KeyFile(path, log_error('', ERROR_PERIOD))
        foreign = foreign_master(rosgraph.get_master_uri() or '', robot, _is_registered(ROBOT), is_own, addresses_of)
        return _remarked(OperatorTransport(
            addresses, key.key, datagrams=Datagrams(size, buffer, tos_mask), renewed=key.renewed,
            report=log_error(robot, ERROR_PERIOD), remarks=[foreign] if foreign else []))
    # a desk with several robots shows the messages of all on one terminal
    return _patiently('the link to %s' % robot if robot else 'the link', connect)


def _key_path(parameters: Parameters) -> str:
    return os.path.expanduser(parameters['key_file'] or DEFAULT_KEY_FILE)


def _for_scp(path: str) -> str:
    """A file of this machine as scp has it on another one."""
    try:
        user = getpass.getuser()
    except (KeyError, OSError):     # a user without a name, as in a container
        user = 'USER'
    return '%s@%s:%s' % (user, socket.gethostname(), os.path.abspath(path))


def foreign_master(uri: str, robot: str, is_robots: bool, is_own: Callable[[str], bool],
                   addresses_of: Callable[[str], Set[int]]) -> Optional[str]:
    """What is wrong where the desk's ROS_MASTER_URI, which a shell may have from a shared master, names the robot's or
    another machine's; None: it is the desk's own.

    :param uri: of the master that this node uses
    :param robot: host:port of the robot, of each of its addresses
    :param is_robots: whether the robot's node is at that master
    :param is_own: whether a host is this machine
    :param addresses_of: the addresses of a host
    """
    host = urllib.parse.urlsplit(uri).hostname or ''
    if not is_robots and (not host or is_own(host)):
        return None
    hosts = [one.partition('%')[0] for one, _ in addresses_in(robot)]
    is_robots = is_robots or host in hosts or any(addresses_of(host) & addresses_of(one) for one in hosts)
    return FOREIGN % (uri, "the robot's own master" if is_robots else "another machine's master", robot)


def _is_registered(node: str) -> bool:
    """Whether this node's master knows a node."""
    try:
        return bool(rosgraph.Master(rospy.get_name()).lookupNode(node))
    except (rosgraph.MasterException, OSError, ValueError):
        return False


def _remarked(transport: LinkTransport) -> LinkTransport:
    """A link, once what this machine lacks was said in the log."""
    for remark in transport.remarks:
        rospy.logwarn('%s', remark)
    return transport


def addresses_in(text: str) -> List[Tuple[str, int]]:
    """The parts of HOST:PORT,HOST%INTERFACE:PORT..., at least one.

    :raises ValueError: where it is not that, or one stands twice, or there are more than MAX_PATHS
    """
    found = [host_and_port(one.strip()) for one in text.split(',')]
    twice = next((one for one in found if found.count(one) > 1), None)
    if twice is not None:
        raise ValueError('robot is %r: %s:%d stands twice' % (text, *twice))
    if len(found) > MAX_PATHS:
        raise ValueError('robot is %r: it has %d addresses, at most %d are used' % (text, len(found), MAX_PATHS))
    return found


def host_and_port(text: str) -> Tuple[str, int]:
    """The parts of HOST:PORT; the host may have an interface.

    :raises ValueError: where it is not that
    """
    host, colon, port = text.rpartition(':')
    if ':' in host:
        raise ValueError('robot is %r: the link uses IPv4 only, give an IPv4 address or a name that has one' % text)
    is_port = port.isascii() and port.isdigit() and 0 < int(port) < 65536
    if not is_port or not colon or not host or host[0] == '%' or host[-1] == '%':
        raise ValueError('robot is %r, must be HOST:PORT, such as 10.0.0.7:17001 or 10.0.0.7%%wwan0:17001' % text)
    return host, int(port)


def _patiently(link: str, make: Callable[[], Transport]) -> Transport:
    """make(), as soon as that is possible.

    :param link: what the log calls it
    """
    log = log_error(link + ' does not start, and this node waits')
    while not rospy.is_shutdown():
        try:
            return make()
        except (ValueError, OSError) as error:
            log(error)
        try:
            time.sleep(RETRY_PERIOD)
        except KeyboardInterrupt:
            break
    sys.exit(0)


def _check_link(value: Any, name: str) -> None:
    """:raises ValueError: where there is a key, but the parameter `name`, which a link needs, is empty"""
    if not value:
        raise ValueError('key_file needs %s: over a shared master all is sent in the clear' % name)
