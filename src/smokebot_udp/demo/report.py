# SPDX-License-Identifier: BSD-3-Clause
"""Compares the streams of both sides for a while: rates, lost datagrams, and the quality and age of images. It also
drives the robot from the operator's side, and says whether it obeys.

Parameters: DEMO_REPORT in nodes/parameters.py.

It subscribes to the topics of both sides, so it is for one machine. It runs at the robot's master; that of the operator
may be another one. Images are paired by their stamps.
"""
import collections
import contextlib
import sys
import time
from typing import Any, Callable, Container, Counter, Dict, Iterable, List, Mapping, Optional, Sequence, Tuple, Union

import cv2
import rospy
from diagnostic_msgs.msg import DiagnosticArray

from ..monitoring.status import OPERATOR, Kind, Status
from ..nodes.common import Parameters, read_streams
from ..nodes.launches import end_own_launch
from ..nodes.parameters import DEMO_REPORT
from ..nodes.status_messages import statuses_of
from ..streams import classified
from ..udpros import rpc
from .comparison import LEGEND, Compared, table
from .drive import DemoDrive, topics_of
from .foreign_publishers import register_publishers
from .images import ImageComparison, stacked

FIRST_IMAGE_TIMEOUT = 60.0
"""After this time without images from every stream the report begins anyway [s]."""

Counts = Tuple[int, int]
"""(received, lost)"""


class DatagramCounts:
    """Counts the datagrams of all streams that arrive at the operator's side and those that are lost."""

    def __init__(self) -> None:
        self._first: Dict[Tuple[str, str], Counts] = {}     # by node and stream
        self._last: Dict[Tuple[str, str], Counts] = {}

    def add(self, statuses: Iterable[Status]) -> None:
        """Take diagnostics."""
        for status in statuses:
            values = status.values
            if (status.kind, status.side) == (Kind.STREAM, OPERATOR) and 'datagrams' in values and 'lost' in values:
                key, counts = (status.node, status.name), (int(values['datagrams']), int(values['lost']))
                self._first.setdefault(key, counts)
                self._last[key] = counts

    def reset(self) -> None:
        """Start counting anew."""
        self._first = dict(self._last)

    def counted(self) -> Counts:
        """(received, lost) since then."""
        received, lost = (sum(max(0, last[part] - self._first[key][part]) for key, last in list(self._last.items()))
                          for part in (0, 1))
        return received, lost


def loss_text(emulated: float, counts: Counts) -> str:
    """The loss in words.

    :param emulated: ratio of datagrams that are dropped on purpose
    """
    received, lost = counts
    lines = ['%g %% of the datagrams dropped on purpose' % (100 * emulated)] if emulated else []
    if received + lost:
        lines.append('%d of %d lost (%.0f %%)' % (lost, received + lost, 100 * lost / (received + lost)))
    return ', '.join(lines or ['no datagrams counted'])


class RateComparison:
    """Counts the messages of one stream on both sides."""

    def __init__(self, name: str, settings: Mapping[str, Any]) -> None:
        self.name, self._settings = name, settings
        self.operator_topics = [settings['operator_topic']]
        self._counts: Counter[str] = collections.Counter()
        self._came = False
        self._subscribers = [rospy.Subscriber(settings[side], rospy.AnyMsg, self._count, side, queue_size=100)
                             for side in ('robot_topic', 'operator_topic')]

    def _count(self, _: Any, side: str) -> None:
        self._counts[side] += 1
        self._came = self._came or side == 'operator_topic'

    def reset(self) -> None:
        """Start counting anew."""
        self._counts.clear()

    def compared(self, seconds: float) -> Compared:
        """The result after `seconds` of comparison."""
        return Compared(self.name, self._settings, self._counts['robot_topic'] / seconds,
                        self._counts['operator_topic'] / seconds, self._came)


def _wait_for_images(comparisons: Sequence[ImageComparison], look: Callable[[], None]) -> None:
    """Wait until an image of each stream was received.

    :param look: f(), called meanwhile
    """
    deadline = time.monotonic() + FIRST_IMAGE_TIMEOUT
    while not rospy.is_shutdown() and not all(comparison.received for comparison in comparisons):
        if time.monotonic() > deadline:
            rospy.logerr('not every stream brought an image within %g s', FIRST_IMAGE_TIMEOUT)
            return
        look()
        time.sleep(0.5)


def _find_operator(master: str, namespace: str, topics: Container[str]) -> None:
    """Make the topics of an operator at another master known here, once it runs.

    :param topics: their resolved names
    """
    with contextlib.suppress(rpc.Unreachable, rpc.Refused):
        register_publishers(master, in_namespace('operator_receiver', namespace), topics)


def in_namespace(topic: str, namespace: str) -> str:
    """The resolved name of a topic or node of the operator's side."""
    return '/' + '/'.join(name.strip('/') for name in (namespace, topic) if name)


def comparisons_of(streams: Mapping[str, Mapping[str, Any]], operator: str, drawn: bool
                   ) -> Tuple[List[ImageComparison], List[RateComparison]]:
    """The comparisons of image streams, and those of the others.

    :param streams: {name: settings}, of those with an encoder
    :param operator: namespace of the operator
    :param drawn: whether the images are to be drawn
    """
    images, others = [], []
    for name, settings in streams.items():
        settings = {**settings, **{topic: in_namespace(settings[topic], operator)
                                   for topic in ('operator_topic', 'view_topic') if settings.get(topic)}}
        if settings['type'] == 'image':
            images.append(ImageComparison(name, settings, drawn))
        elif not settings['robot_topic'].startswith('~'):      # only robot_sender resolves those
            others.append(RateComparison(name, settings))
    return images, others


def report(title: str, lines: Sequence[str]) -> None:
    """Print at once: several robots report at the same time."""
    sys.stdout.write('\n'.join(['', title, *('  ' + line for line in lines), '', '']))
    sys.stdout.flush()


def _drive_for(seconds: float, drive: Optional[DemoDrive]) -> float:
    """Drive, if possible, for this time; returns how long it took [s]."""
    start = time.monotonic()
    if drive:
        drive.run(seconds)
    while not rospy.is_shutdown() and time.monotonic() - start < seconds:
        time.sleep(0.1)
    return time.monotonic() - start


def main() -> None:
    rospy.init_node('demo_report')
    parameters = Parameters(DEMO_REPORT)
    seconds, path, operator = parameters['seconds'], parameters['picture'], parameters['operator']
    definitions = read_streams(parameters)
    topics_to_robot = topics_of(definitions, lambda topic: in_namespace(topic, operator))
    # before the comparisons: the first subscriber of a topic determines the type for the whole node; theirs is AnyMsg
    drive = DemoDrive(topics_to_robot, parameters['frame_prefix']) if topics_to_robot else None
    images, others = comparisons_of(classified(definitions).streams, operator, bool(path))
    datagrams = DatagramCounts()
    rospy.Subscriber('/diagnostics', DiagnosticArray, lambda message: datagrams.add(
        statuses_of(message.status)), queue_size=20)
    comparisons: List[Union[ImageComparison, RateComparison]] = [*images, *others]
    master, topics = parameters['operator_master'], {
        '/diagnostics', *(topic for one in comparisons for topic in one.operator_topics), *(topics_to_robot or ())}

    def look() -> None:
        if master:
            _find_operator(master, operator, topics)
    _wait_for_images(images, look)
    with drive.connected(master, look) if drive else contextlib.nullcontext():
        for one in (*comparisons, datagrams):
            one.reset()
        elapsed = _drive_for(seconds, drive)
    counts = datagrams.counted()
    lines = table([comparison.compared(elapsed) for comparison in comparisons], counts[1] / max(sum(counts), 1))
    if drive:
        lines.append(drive.line())
    pictures = [picture for picture in (comparison.picture() for comparison in images) if picture is not None]
    if pictures:
        cv2.imwrite(path, stacked(pictures))
        lines.append('sent beside what the operator sees: %s' % path)
    report('%sver %.0f s, %s:' % (operator + ', o' if operator else 'O', elapsed,
                                  loss_text(parameters['loss'], counts)), [*lines, *LEGEND.splitlines()])
    if parameters['end_launch']:
        end_own_launch()
