# SPDX-License-Identifier: BSD-3-Clause
"""The robot's side: sends the streams of a streams.yaml to operators, as the mission focus requests.

Parameters: ROBOT_SENDER in nodes/parameters.py, listed in doc/parameters.md.

Each stream subscribes its robot_topic and publishes /smokebot_udp/<stream>/segments, an image stream that may be
layered also /smokebot_udp/<stream>/layers, one that may be video also /smokebot_udp/<stream>/video, and a map that may
be in tiles also /smokebot_udp/<stream>/tiles. With camera_info an image stream also publishes
/smokebot_udp/<stream>/camera_info. Operators report on /smokebot_udp/held what they hold. ~status (latched) shows the
focus and the settings of each stream, ~focus/modified (latched) whether any of them was set by hand since the focus was
switched, ~link the state of the link, ~estop (latched) whether the emergency stop is engaged. Services: ~set_focus,
~set_estop.

Commands, services, actions and reliable relays of operators come back over the same link, see way_back.py.
"""
import collections
import functools
import math
import random
import time
from typing import Any, DefaultDict, Dict, Mapping, Tuple, Type

import rospy

from .. import optional, udpros
from ..capture.history import Histories
from ..congestion.controller import Controller
from ..congestion.estimator import Limits
from ..congestion.packet_scheduler import PacketScheduler
from ..limited_log import logerr
from ..mission import focus
from ..monitoring.status import ROBOT
from ..streams import classified, encoder_class
from ..streams.virtual_scan.fans import FanCache
from ..udpros.datagram import IP_UDP_HEADERS
from ..units import MBIT
from . import garbage, malloc_tuning
from .clock_sync import ClockServer
from .common import Parameters, read_file, read_streams, start_streams
from .compiled_codec import CompiledCodec
from .derived_stream import DerivedStream
from .diagnostics import robot_diagnostics
from .focus import FocusControl
from .held_reports import HeldReports
from .level_frame import TransformLookup
from .link_control import LinkControl, SharedController
from .namesake import wait_until_free
from .opened import Opened, open_until_end
from .outbox import Outbox
from .parameters import ROBOT_SENDER
from .path_settings import PathSettings
from .problems import Problems
from .relay_stream import RelayStream
from .reliable_link import ReliableLink
from .robot_captures import RobotCaptures
from .robot_control import RobotControl
from .robot_stream import RobotLink, RobotStream
from .stream_problems import StreamProblems
from .transports import robot_transport
from .way import RobotWay
from .way_back import WayBack

BURST = 16
"""Datagrams that may leave at once on a fast link: roscpp's receiver holds 92, a Wi-Fi driver's queue not many more."""

MEGABYTE = 1 << 20

RUNNERS: Mapping[str, Type[RobotStream]] = {'relay': RelayStream, 'virtual_scan': DerivedStream}
"""{type of stream: its runner}; all others have RobotStream."""


class _StreamMaker:
    """Makes streams, with the work that they share.

    :param codec: of layered images, tiles and clouds
    """

    def __init__(self, link: RobotLink, codec: CompiledCodec) -> None:
        self._link, self._codec, self.lookup = link, codec, TransformLookup()
        # by the cloud's topic
        self._fans: DefaultDict[str, FanCache] = collections.defaultdict(lambda: FanCache(self.lookup, codec))

    def __call__(self, name: str, settings: Dict[str, Any]) -> RobotStream:
        kind = settings['type']
        shared: Dict[str, Any] = {}
        if kind == 'virtual_scan':
            shared = {'fans': self._fans[rospy.resolve_name(settings['robot_topic'])]}
            self.lookup.prepare()
        elif kind in ('image', 'grid'):
            shared = {'codec': self._codec, 'clock': time.monotonic}
        elif kind == 'cloud':
            shared = {'codec': self._codec}
            tell_of_pcl()
        elif kind == 'relay':
            shared = {'number': random.getrandbits(32)}
        if kind == 'grid':
            shared['lookup'] = self.lookup
            self.lookup.prepare()
        return RUNNERS.get(kind, RobotStream)(name, settings, encoder_class(kind)(settings, **shared), self._link)


@functools.lru_cache(maxsize=None)      # once
def tell_of_pcl() -> None:
    """Say what filters clouds, where it is not PCL."""
    problem = optional.attempt('pcl').problem
    if problem:
        rospy.loginfo('%s: clouds are filtered by loops that numba compiles, or by numpy where it is missing', problem)


def run_streams(opened: Opened) -> Tuple[Dict[str, RobotStream], Dict[str, Any]]:
    """Start all parts of the node, which live as long as it does; returns {name: stream}, those of the way back apart.

    :param opened: what closes them
    """
    problems = Problems()
    parameters = Parameters(ROBOT_SENDER, problems.report)
    udpros.emulate_loss(parameters['loss'], parameters['loss_seed'])
    defined = read_streams(parameters)
    definitions = classified(defined)
    transport = opened.add(robot_transport(parameters))
    size = transport.max_datagram_size
    profiles = read_file(parameters, 'focus_file', 'focus.yaml', lambda text, warn: focus.load(text))
    found = StreamProblems(parameters.refused)
    controller = Controller(*_rates(parameters), size)
    shared = SharedController(controller)
    burst = BURST * (size + transport.overhead + IP_UDP_HEADERS)
    scheduler = PacketScheduler(controller.rate(time.monotonic()), burst)
    outbox = Outbox(scheduler, shared.on_sent, _log, shared.route, transport.overhead, shared.on_sent_besides)
    opened.callback(outbox.stop)
    codec = opened.add(CompiledCodec())
    with udpros.registered_together():
        link = RobotLink(transport, outbox, histories=Histories(parameters['history_memory'] * MEGABYTE))
        outbox.start()
        maker = _StreamMaker(link, codec)
        streams = start_streams(definitions.streams, maker, parameters.report, parameters.refused.__setitem__)
        for stream in streams.values():
            opened.add(stream)
        captures = opened.add(RobotCaptures(link, streams, maker.lookup, codec, parameters['capture_share'],
                                            defined.frames.fixed))
        control = opened.add(RobotControl(transport, outbox))
        reliable = opened.add(ReliableLink(transport, ROBOT, outbox))
        way_back = WayBack(ROBOT, definitions, RobotWay(transport, control, reliable), parameters)
        paths = PathSettings(parameters['metered'], parameters['metered_rate'], problems.report)
        rate = opened.add(LinkControl(shared, link, streams, control.reported, parameters['wifi_interface'],
                                      paths.mark, captures.demands))
        stores = {name: stream.settings for name, stream in streams.items()}
        focus_control = opened.add(FocusControl({**stores, **way_back.stores}, profiles, transport.own_masters,
                                                reliable, rate, control, found, problems.report))
        paths.serve(focus_control.add)
        reliable.start()
        opened.add(ClockServer(transport))
        opened.add(HeldReports(streams, transport))
        opened.add(robot_diagnostics(streams, way_back, rate, parameters, problems, transport, found))
    opened.add(way_back)    # the last one, so it ends first: it stops a robot that is driven
    return streams, way_back.streams


def _rates(parameters: Parameters) -> Tuple[Limits, bool]:
    """(Limits, whether the rate follows the reports)"""
    most = parameters['max_rate'] or math.inf
    least, start = min(parameters['min_rate'], most), parameters['start_rate']
    return Limits(least * MBIT, start * MBIT, most * MBIT), parameters['adapt']


def _log(stream: str, error: Exception) -> None:
    logerr("stream '%s' cannot be sent" % stream, error)


def main() -> None:
    malloc_tuning.keep_freed_memory()
    udpros.race_all_connections()
    wait_until_free('robot_sender', 'A master can have one robot_sender.')
    udpros.init_node('robot_sender')
    with open_until_end() as opened:
        streams, way_back = run_streams(opened)
    garbage.collect_regularly()
    rospy.loginfo('robot_sender: sending %s%s', ', '.join(streams) or 'nothing: no stream is valid',
                  '; also %s' % ', '.join(way_back) if way_back else '')
    rospy.spin()
