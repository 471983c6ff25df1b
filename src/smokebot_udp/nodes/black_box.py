# SPDX-License-Identifier: BSD-3-Clause
"""The black box of one side: records its streams and the state of the link in bags, by rosbag record.

Parameters: BLACK_BOX in nodes/parameters.py. `mission_report` makes a page of the bags, see doc/black_box.md.

rosbag record registers once: it is ended and started again at a new master, and started again where it crashes. Each
bag says by ~description (latched) which side it is of, and which topics belong to which stream.
"""
import functools
import json
import os
import pathlib
import time
from typing import Dict, List, Mapping, Optional, Tuple

import rosgraph
import roslib.packages
import rospkg
import rospy
from std_msgs.msg import Float64, String

from .. import udpros
from ..limited_log import logerr, logwarn
from ..mission_report.record import LOAD_PERIOD
from ..streams.recorded_topics import RecordedStream, all_topics, recorded_streams
from ..udpros import rpc
from ..udpros.master import MasterWatch
from .bag_store import MB, BagStore
from .common import Parameters, operator_topic, read_streams
from .launches import Launch, end_all
from .logging import log_error
from .machine_load import present_load
from .namesake import SECOND_OPERATOR, wait_until_free
from .parameters import BLACK_BOX
from .recorded_images import RecordedImages, topics_of
from .worker import PeriodicWorker

PERIOD = 1.0
"""How often the disk, the master and rosbag are looked at [s]."""

BUFFER = 128
"""What waits for a slow disk; what does not fit is lost [MB]."""

CHUNK = 128
"""What is lost if rosbag crashes or the power fails: 1 s of small images [kB]."""

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


def chosen(streams: Mapping[str, RecordedStream], names: str) -> Tuple[Dict[str, RecordedStream], List[str]]:
    """Those of the streams that are to be recorded, and names of which there is none.

    :param names: separated by commas; empty: all
    """
    wanted = [name.strip() for name in names.split(',') if name.strip()]
    if not wanted:
        return dict(streams), []
    return ({name: stream for name, stream in streams.items() if name in wanted},
            [name for name in wanted if name not in streams])


def with_images(stream: RecordedStream) -> RecordedStream:
    """A stream of images, with the topics on which this node publishes what is recorded of it."""
    return stream._replace(topics=[str(rospy.resolve_name(name)) for topic in stream.topics
                                   for name in topics_of(topic)])


def recording(record: str, topics: List[str], prefix: str, split: int, least_free: int, name: str) -> List[str]:
    """The command that records.

    :param record: path of rosbag's program
    :param prefix: of the bags' paths
    :param split: size of a bag [MB]
    :param least_free: when rosbag itself ends recording, should nobody have ended it before [MB]
    :param name: of its node, in the namespace of this one
    """
    return ['sh', '-c', QUIETLY, record, '--quiet', '--lz4', '--split', '--size=%d' % split, '--buffsize=%d' % BUFFER,
            '--chunksize=%d' % CHUNK, '--repeat-latched', '--min-space=%dM' % least_free,
            '--output-prefix=' + prefix, *topics, '__name:=' + name]


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

    streams, unknown = chosen(recorded_streams(read_streams(parameters), side, resolve), parameters['record_streams'])
    if unknown:
        rospy.logwarn('record_streams names %s, which is no stream; recorded are %s', ', '.join(unknown),
                      ', '.join(streams) or 'none')
    images = {name: stream for name, stream in streams.items() if stream.type == 'image'} if (
        parameters['lossless']) else {}
    streams = {name: with_images(stream) if name in images else stream for name, stream in streams.items()}
    said = udpros.Publisher('~description', String, queue_size=1, latch=True)
    said.publish(description(side, namespace, streams))
    prefix = bag_prefix(side, namespace)
    store = _store(parameters, prefix)
    loads = udpros.Publisher('~load', Float64, queue_size=10)
    topics = [*all_topics(streams, side, resolve), said.resolved_name, loads.resolved_name]
    recorded = RecordedImages([topic for stream in images.values() for topic in stream.topics],
                              parameters['image_rate'], functools.partial(logwarn, 'the black box'))
    load = PeriodicWorker('load', lambda: loads.publish(present_load()), log_error("this machine's load"), LOAD_PERIOD)
    load.start()
    split = max(1, min(parameters['split_mb'], parameters['max_mb'] // SPLITS))
    rospy.loginfo('black box: recording %d topics in %s', len(topics), store.folder / (prefix + '_*.bag'))
    least_free, name = max(1, parameters['min_free_mb'] // 2), rospy.get_name().split('/')[-1] + '_recorder'
    BlackBox(store, recording(record, topics, str(store.folder / prefix), split, least_free, name)).run()
    load.close()
    recorded.close()
