# SPDX-License-Identifier: BSD-3-Clause
"""The black box of one side: records its streams and the state of the link in bags, by rosbag record.

Parameters: BLACK_BOX in nodes/parameters.py. `mission_report` makes a page of the bags, see doc/black_box.md.

rosbag record registers once: it is ended and started again at a new master, and started again where it crashes. Each
bag says by ~description (latched) which side it is of, and which topics belong to which stream.
"""
import json
import os
import pathlib
import time
from typing import List, Mapping, Optional

import rosgraph
import roslib.packages
import rospkg
import rospy
from std_msgs.msg import String

from .. import udpros
from ..limited_log import logerr
from ..streams.recorded_topics import RecordedStream, all_topics, recorded_streams
from ..udpros import rpc
from ..udpros.master import MasterWatch
from .bag_store import MB, BagStore
from .common import Parameters, operator_topic, read_streams
from .launches import Launch, end_all
from .logging import log_error
from .namesake import SECOND_OPERATOR, wait_until_free
from .parameters import BLACK_BOX

PERIOD = 1.0
"""How often the disk, the master and rosbag are looked at [s]."""

BUFFER = 128
"""What waits for a slow disk; what does not fit is lost [MB]."""

SPLITS = 4
"""The limit is as much as this many bags at least: the oldest is deleted for the newest."""

QUIETLY = 'exec "$0" "$@" >/dev/null'
"""A shell's script that runs its arguments: rosbag writes a line for each topic; its errors go to stderr."""


def side_topic(side: str, name: str) -> str:
    """The full name of a topic of streams.yaml on this side.

    :param name: ~ is the node robot_sender or operator_receiver
    """
    node = rospy.resolve_name('robot_sender' if side == 'robot' else 'operator_receiver')
    return operator_topic(name) if side == 'operator' and name[0] != '~' else str(rospy.resolve_name(name, node))


def bag_prefix(side: str, namespace: str) -> str:
    """The beginning of the bags' names: black_box_operator_desk2 in the namespace /desk2/."""
    return '_'.join(['black_box', side, *namespace.strip('/').split('/')]).rstrip('_')


def description(side: str, namespace: str, streams: Mapping[str, RecordedStream]) -> str:
    """What a bag says of itself, JSON."""
    return json.dumps({'side': side, 'namespace': namespace,
                       'streams': {name: stream._asdict() for name, stream in streams.items()}})


def recording(record: str, topics: List[str], prefix: str, split: int, least_free: int, name: str) -> List[str]:
    """The command that records.

    :param record: path of rosbag's program
    :param prefix: of the bags' paths
    :param split: size of a bag [MB]
    :param least_free: when rosbag itself ends recording, should nobody have ended it before [MB]
    :param name: of its node, in the namespace of this one
    """
    return ['sh', '-c', QUIETLY, record, '--quiet', '--lz4', '--split', '--size=%d' % split, '--buffsize=%d' % BUFFER,
            '--repeat-latched', '--min-space=%dM' % least_free, '--output-prefix=' + prefix, *topics, '__name:=' + name]


class BlackBox:
    """Keeps rosbag record running while the disk has space.

    :param command: that records
    """

    def __init__(self, store: BagStore, command: List[str]) -> None:
        self._store, self._command = store, command
        self._launch: Optional[Launch] = None
        self._master = MasterWatch(rosgraph.get_master_uri(), rospy.get_node_uri())
        self._told = False      # that it does not record
        self._log_error = log_error('the black box')

    def run(self) -> None:
        """Return when the node shuts down, and the last bag is closed."""
        try:
            while not rospy.is_shutdown():
                try:
                    self._step()
                except Exception as error:      # a bug of ours must not end the recording
                    self._log_error(error)
                time.sleep(PERIOD)
        finally:
            self._end()

    def _step(self) -> None:
        for name in self._store.prune():
            rospy.loginfo('black box: %s is deleted: all bags together have reached their limit, or the disk is nearly '
                          'full', name)
        problem = self._store.problem()
        if problem and not self._told:
            self._told = logerr('the black box does not record', problem + '. It goes on when that has changed')
        elif not problem and self._told:
            rospy.loginfo('the black box records again')
            self._told = False
        if problem or self._master_is_new():
            self._end()
        if not problem:
            self._launch = self._launch or Launch('rosbag record', self._command)
            self._launch.keep(time.monotonic())

    def _master_is_new(self) -> bool:
        try:
            is_new = self._master.is_new()
        except (rpc.Unreachable, rpc.Refused) as error:
            rospy.logdebug('black box: the master does not answer: %s', error)
            return False
        if is_new:
            self._master.registered()
        return is_new

    def _end(self) -> None:
        """End recording; the bag is closed."""
        if self._launch is not None:
            end_all([self._launch])
            self._launch = None


def _find_record() -> str:
    """The path of rosbag's program.

    :raises LookupError: where it is not installed
    """
    try:
        return str(roslib.packages.find_node('rosbag', 'record')[0])
    except (rospkg.ResourceNotFound, IndexError):
        raise LookupError('rosbag is not installed') from None


def _store(parameters: Parameters, prefix: str) -> BagStore:
    folder = pathlib.Path(os.path.expanduser(parameters['folder'] or os.path.join(rospkg.get_ros_home(), 'black_box')))
    return BagStore(folder, prefix, parameters['max_mb'] * MB, parameters['min_free_mb'] * MB)


def main() -> None:
    udpros.race_all_connections()
    wait_until_free('black_box', SECOND_OPERATOR)
    udpros.init_node('black_box')
    parameters = Parameters(BLACK_BOX)
    try:
        record = _find_record()
    except LookupError as error:
        rospy.logerr('the black box does not record: %s', error)
        rospy.spin()
        return
    side, namespace = parameters['side'], rospy.get_namespace()

    def resolve(name: str) -> str:
        return side_topic(side, name)

    streams = recorded_streams(read_streams(parameters), side, resolve)
    said = udpros.Publisher('~description', String, queue_size=1, latch=True)
    said.publish(description(side, namespace, streams))
    prefix = bag_prefix(side, namespace)
    store = _store(parameters, prefix)
    topics = [*all_topics(streams, side, resolve), said.resolved_name]
    split = max(1, min(parameters['split_mb'], parameters['max_mb'] // SPLITS))
    rospy.loginfo('black box: recording %d topics in %s', len(topics), store.folder / (prefix + '_*.bag'))
    least_free, name = max(1, parameters['min_free_mb'] // 2), rospy.get_name().split('/')[-1] + '_recorder'
    BlackBox(store, recording(record, topics, str(store.folder / prefix), split, least_free, name)).run()
