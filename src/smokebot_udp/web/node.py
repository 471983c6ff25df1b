# SPDX-License-Identifier: BSD-3-Clause
"""The page for browsers, of one robot or of all robots of a desk.

Parameters: OPERATOR_WEB in nodes/parameters.py. It subscribes what the operator's side publishes on its own machine,
publishes operator/cmd_vel, operator/estop and the goal, and calls the services of operator_receiver, all in the
namespace of each robot. ~browsers (UInt16, latched) is the number of browsers. Where it cannot listen, it says why and
tries again; nothing else of the operator's side depends on it.
"""
import asyncio
import contextlib
import functools
import os
from typing import Any, Callable, Dict, Optional, Tuple

import rospkg
import rospy
from std_msgs.msg import UInt16

from .. import udpros
from ..limited_log import logerr
from ..link.keys import read_key
from ..mission import robots
from ..mission.footprint import DEFAULT_FOOTPRINT, Footprint, read_footprint
from ..nodes import garbage, malloc_tuning
from ..nodes.common import Parameters, read_file, read_streams
from ..nodes.namesake import SECOND_OPERATOR, wait_until_free
from ..nodes.opened import Opened, open_until_end
from ..nodes.parameters import OPERATOR_RECEIVER, OPERATOR_WEB
from ..optional import attempt
from ..streams import config

RETRY_PERIOD = 5.0
"""A port that is in use, or a file that is wrong, is tried again after this time [s]."""

SAME_ERROR_PERIOD = 600.0
"""[s]"""

END_TIMEOUT = 2.0
"""Time for connections to end with the node [s]."""

LOCAL = 'localhost', '127.0.0.1', '::1'


class Impossible(Exception):
    """The page cannot be served, in one sentence."""


def stations_of(parameters: Parameters, opened: Opened, came: Callable[[str, str], None]) -> Dict[str, Any]:
    """{robot: Station} of all robots of this desk.

    :param came: f(robot, stream), called in any thread where a picture came
    """
    own = rospy.get_namespace().strip('/').replace('/', '_')
    streams = read_streams(parameters)
    if not parameters['robots_file']:
        return {own: station_of(own, '', streams, parameters, opened, came,
                                (parameters['frame_prefix'], parameters['footprint']))}
    folder = os.path.dirname(os.path.abspath(parameters['robots_file']))
    found = read_file(parameters, 'robots_file', 'robots.yaml', lambda text, warn: robots.load(text))
    stations = {}
    for name, robot in found.items():
        theirs = streams
        if robot['streams']:
            path = os.path.join(folder, os.path.expanduser(robot['streams']))
            theirs = streams_in(path)
        stations[name] = station_of(name, name, theirs, parameters, opened, came,
                                    (robot['frame_prefix'], robot['footprint'] or DEFAULT_FOOTPRINT))
    return stations


def streams_in(path: str) -> config.Streams:
    """The good streams of a robot's own file; operator_receiver says what is wrong with it."""
    try:
        with open(path) as file:
            return config.load(file.read())[0]
    except (OSError, UnicodeDecodeError):
        return config.Streams()


def station_of(name: str, namespace: str, streams: Any, parameters: Parameters, opened: Opened,
               came: Callable[[str, str], None], look: Tuple[str, str]) -> Any:
    """The Station of a robot.

    :param name: by which browsers know it
    :param namespace: relative to the node's
    :param look: prefix of the robot's frames, its footprint
    """
    from .catalogue import Catalogue
    from .dead_man import scale_of
    from .desk import Station
    from .driving import Driving
    from .robot import Robot

    def resolve(topic: str) -> str:
        return str(rospy.resolve_name('%s/%s' % (namespace, topic) if namespace else topic))

    catalogue = Catalogue(streams)
    robot = opened.add(Robot(name, resolve, catalogue, streams.frames, look[0], functools.partial(came, name)))
    speeds = parameters['speed'], parameters['strafe'], parameters['turn']
    captures = rospy.get_param(resolve('operator_receiver/capture_directory'),
                               OPERATOR_RECEIVER['capture_directory'].default)
    return Station(robot, opened.add(Driving(robot)), scale_of(speeds[0], speeds[2], speeds[1]),
                   catalogue.described(name, speeds, footprint_of(look[1])), os.path.expanduser(str(captures)))


def footprint_of(text: str) -> Footprint:
    """The footprint of a text; none where it is wrong: operator_receiver says so."""
    try:
        return read_footprint(text)
    except ValueError:
        return ()


def token_of(parameters: Parameters, name: str) -> Optional[bytes]:
    """The token in the file that a parameter names; None: it names none.

    :raises Impossible: the file cannot be used
    """
    path = os.path.expanduser(parameters[name])
    try:
        return read_key(path) if path else None
    except ValueError as error:
        raise Impossible('%s: %s' % (name, error)) from None


async def listen(parameters: Parameters, desk: Any) -> Any:
    """The Server, which listens.

    :raises Impossible: it cannot
    """
    from .access import Access
    from .server import Server, tls_of
    address, port = parameters['web_address'], parameters['web']
    page, driver = token_of(parameters, 'web_token_file'), token_of(parameters, 'web_driver_token_file')
    if page is not None and page == driver:
        raise Impossible('web_token_file and web_driver_token_file have the same token: whoever sees the page could '
                         'drive')
    try:
        tls = tls_of(os.path.expanduser(parameters['web_certificate']))
    except ValueError as error:
        raise Impossible(str(error)) from None
    server = Server(desk, Access(page, driver), os.path.join(rospkg.RosPack().get_path('smokebot_udp'), 'web'), tls)
    try:
        await server.start(address, port)
    except (OSError, UnicodeError) as error:
        raise Impossible('web_address %s, port %d: %s' % (
            address, port, getattr(error, 'strerror', None) or error)) from None
    rospy.loginfo('operator_web: %s://%s:%d%s', 'http' if tls is None else 'https', address, port, standing(
        page, driver))
    if tls is None and address not in LOCAL:
        rospy.logwarn('operator_web: without web_certificate tokens and pictures cross the network unencrypted')
    return server


def standing(page: Optional[bytes], driver: Optional[bytes]) -> str:
    """Who may do what, in words."""
    return ', %s, %s' % ('for who has the token' if page is not None else 'for browsers on this machine only',
                         'driving with the driver\'s token' if driver is not None else
                         'nobody drives: web_driver_token_file is empty')


async def serve(parameters: Parameters, desk: Any, ended: asyncio.Event) -> None:
    """Serve until the node ends; what makes it impossible is reported, and tried again."""
    ticking = asyncio.ensure_future(desk.run())
    server = None
    while not ended.is_set():
        if server is None:
            try:
                server = await listen(parameters, desk)
            except Impossible as error:
                logerr('there is no page for browsers', error, SAME_ERROR_PERIOD)
        with contextlib.suppress(asyncio.TimeoutError):
            await asyncio.wait_for(ended.wait(), None if server is not None else RETRY_PERIOD)
    ticking.cancel()
    if server is not None:
        with contextlib.suppress(asyncio.TimeoutError):
            await asyncio.wait_for(server.stop(), END_TIMEOUT)


def main() -> None:
    malloc_tuning.keep_freed_memory()
    udpros.race_all_connections()
    wait_until_free('operator_web', SECOND_OPERATOR)
    udpros.init_node('operator_web')
    parameters = Parameters(OPERATOR_WEB)
    problem = attempt('aiohttp').problem
    if problem or not parameters['web']:
        logerr('there is no page for browsers', problem or 'web is 0, must be a port')
        rospy.spin()
        return
    loop = asyncio.new_event_loop()
    asyncio.set_event_loop(loop)
    run(parameters, loop)


def run(parameters: Parameters, loop: asyncio.AbstractEventLoop) -> None:
    """Serve in this thread until the node ends."""
    from .desk import Desk
    stations: Dict[str, Any] = {}
    ended = asyncio.Event()
    # of udpros: it registers all topics of the node again at a restarted master
    browsers = udpros.Publisher('~browsers', UInt16, queue_size=1, latch=True)
    desk = Desk(stations, browsers.publish)
    with open_until_end() as opened:
        opened.callback(loop.call_soon_threadsafe, ended.set)     # the first one, so it ends last
        stations.update(stations_of(parameters, opened, desk.picture_came))
    garbage.collect_regularly()
    loop.run_until_complete(serve(parameters, desk, ended))
