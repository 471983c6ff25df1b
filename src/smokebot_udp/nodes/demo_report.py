# SPDX-License-Identifier: BSD-3-Clause
"""Compares the streams of both sides for a while: rates, lost datagrams, and the quality and age of images. It also
drives the robot from the operator's side, and says whether it obeys.

Parameters: DEMO_REPORT in nodes/parameters.py.

It subscribes to the topics of both sides, so it is for one machine. It runs at the robot's master; that of the operator
may be another one. Images are paired by their stamps.
"""
import collections
import contextlib
import math
import sys
import threading
import time
from typing import Any, Callable, Container, Counter, Dict, Iterable, List, Mapping, Optional, Sequence, Tuple, Union

import cv2
import numpy as np
import rospy
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import Image

from ..arrays import Array, UInt8Array
from ..codecs.wire.pixels import as_pixels
from ..monitoring.link_board import NodeStatus
from ..monitoring.status import OPERATOR
from ..streams import classified
from ..udpros import rpc
from .common import Parameters, read_streams
from .demo_drive import DemoDrive, topics_of
from .foreign_publishers import register_publishers
from .launches import end_own_launch
from .link_top import as_status
from .parameters import DEMO_REPORT

MAX_WAITING = 64
"""Number of sent images that wait for the received ones with the same stamps."""

FIRST_IMAGE_TIMEOUT = 60.0
"""After this time without images from every stream the report begins anyway [s]."""

EXPECTED = """\
  Expected of relays: the lower of the first two rates, minus the lost datagrams: each one is a message. tf merges
  messages. Expected of all other streams: the lower of the first two rates; messages are less complete instead. The
  rates of a slow link are lower."""

Counts = Tuple[int, int]
"""(received, lost)"""


class DatagramCounts:
    """Counts the datagrams of all streams that arrive at the operator's side and those that are lost."""

    def __init__(self) -> None:
        self._first: Dict[Tuple[str, str], Counts] = {}     # by node and stream
        self._last: Dict[Tuple[str, str], Counts] = {}

    def add(self, statuses: Iterable[NodeStatus]) -> None:
        """Take diagnostics."""
        for status in statuses:
            values = status.values
            if status.kind == 'stream' and values['side'] == OPERATOR and 'datagrams' in values and 'lost' in values:
                key, counts = (status.node, status.stream), (int(values['datagrams']), int(values['lost']))
                self._first.setdefault(key, counts)
                self._last[key] = counts

    def reset(self) -> None:
        """Start counting anew."""
        self._first = dict(self._last)

    def line(self) -> str:
        """The report."""
        received, lost = (sum(max(0, last[part] - self._first[key][part]) for key, last in list(self._last.items()))
                          for part in (0, 1))
        if not received + lost:
            return 'datagrams: none counted'
        return 'datagrams: %d of %d lost (%.0f %%)' % (lost, received + lost, 100 * lost / (received + lost))


def rates(source: float, settings: Mapping[str, Any], received: float) -> str:
    """The rates of a stream, in words.

    :param source: rate of the messages on the robot [Hz]
    :param settings: of the stream
    :param received: rate of the messages published for the operator [Hz]
    """
    if settings.get('latch'):
        return '%5.1f Hz source, latched, %5.1f received' % (source, received)
    return '%5.1f Hz source, at most %g Hz wanted, %5.1f received' % (source, settings['rate'], received)


class ImageComparison:
    """Compares the images of one stream on both sides."""

    def __init__(self, name: str, settings: Mapping[str, Any]) -> None:
        self.name, self._settings = name, settings
        self.operator_topic = settings['operator_topic']
        self.sent, self.received = 0, 0
        self.pair: Optional[Tuple[Array, Array]] = None
        """The pixels of the last image, (sent, received)."""
        self._psnr: List[float] = []
        self._ages: List[float] = []
        self._waiting: collections.OrderedDict[Any, Any] = collections.OrderedDict()   # {stamp: message}
        self._lock = threading.Lock()
        self._subscribers = [
            rospy.Subscriber(settings['robot_topic'], Image, self._on_sent, queue_size=20, buff_size=1 << 24),
            rospy.Subscriber(settings['operator_topic'], Image, self._on_received, queue_size=20, buff_size=1 << 24)]

    def _on_sent(self, message: Any) -> None:
        with self._lock:
            self.sent += 1
            self._waiting[message.header.stamp] = message
            while len(self._waiting) > MAX_WAITING:
                self._waiting.popitem(last=False)

    def _on_received(self, message: Any) -> None:
        age = (rospy.Time.now() - message.header.stamp).to_sec()
        with self._lock:
            self.received += 1
            self._ages.append(age)
            source = self._waiting.pop(message.header.stamp, None)
        if source is not None:
            pair = _pixels(source), _pixels(message)
            quality = psnr(*pair)
            with self._lock:
                self._psnr.append(quality)
                self.pair = pair

    def reset(self) -> None:
        """Start counting anew."""
        with self._lock:
            self.sent = self.received = 0
            del self._psnr[:], self._ages[:]

    def line(self, seconds: float) -> str:
        """The report after `seconds` of comparison."""
        with self._lock:
            if not self._ages:
                return '%-13s no image received (%d sent)' % (self.name, self.sent)
            lossy = [value for value in self._psnr if not math.isinf(value)]
            quality = 'PSNR %.1f dB' % np.mean(lossy) if lossy else 'all exact'
            return '%-13s %s, %s, age p50 %.0f ms, p99 %.0f ms' % (
                self.name, rates(self.sent / seconds, self._settings, self.received / seconds), quality,
                1e3 * np.percentile(self._ages, 50), 1e3 * np.percentile(self._ages, 99))


class RateComparison:
    """Counts the messages of one stream on both sides."""

    def __init__(self, name: str, settings: Mapping[str, Any]) -> None:
        self.name, self._settings = name, settings
        self.operator_topic = settings['operator_topic']
        self._counts: Counter[str] = collections.Counter()
        self._subscribers = [rospy.Subscriber(settings[side], rospy.AnyMsg, self._count, side, queue_size=100)
                             for side in ('robot_topic', 'operator_topic')]

    def _count(self, _: Any, side: str) -> None:
        self._counts[side] += 1

    def reset(self) -> None:
        """Start counting anew."""
        self._counts.clear()

    def line(self, seconds: float) -> str:
        """The report after `seconds` of comparison."""
        return '%-13s %s' % (self.name, rates(
            self._counts['robot_topic'] / seconds, self._settings, self._counts['operator_topic'] / seconds))


def _pixels(message: Any) -> Array:
    return as_pixels(message.data, message.height, message.width, message.step, message.encoding, message.is_bigendian)


def psnr(sent: Array, received: Array) -> float:
    """Peak signal-to-noise ratio [dB]; infinite if the images are equal.

    The peak is 255 where the pixels of the sent image fit in a byte, otherwise it is the range of its pixels.

    :param sent, received: (height, width) or (height, width, channels) arrays of the same type, in native byte order
    """
    if np.array_equal(sent, received):
        return math.inf
    peak = 255.0 if sent.max() <= 255 else float(sent.max()) - float(sent.min())
    return float(cv2.PSNR(np.ascontiguousarray(sent), np.ascontiguousarray(received), peak))


def _for_display(pixels: Array, low: float, high: float) -> UInt8Array:
    """(height, width, 3) uint8 BGR; pixels of more than 8 bits are coloured by a palette from `low` to `high`."""
    if pixels.dtype == np.uint8 and pixels.ndim == 3:
        return pixels[..., :3]
    if pixels.dtype == np.uint8:
        return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_GRAY2BGR))
    scaled = np.clip((pixels.astype(np.float32) - low) * (255.0 / max(high - low, 1e-6)), 0, 255)
    return np.asarray(cv2.applyColorMap(scaled.astype(np.uint8), cv2.COLORMAP_INFERNO))


def side_by_side(comparisons: Sequence[ImageComparison]) -> UInt8Array:
    """(rows, columns, 3) uint8 BGR: a row for each stream, the sent image on the left, the received on the right."""
    rows = []
    for comparison in comparisons:
        if comparison.pair is None:
            continue
        low, high = np.percentile(comparison.pair[0], (0.5, 99.8))
        row = np.hstack([_for_display(pixels, low, high) for pixels in comparison.pair])
        for text, column in (('%s: sent' % comparison.name, 8), ('received', row.shape[1] // 2 + 8)):
            for colour, thickness in ((0, 3), (255, 1)):
                cv2.putText(row, text, (column, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.7, (colour,) * 3, thickness,
                            cv2.LINE_AA)
        rows.append(row)
    width = max(row.shape[1] for row in rows)
    return np.vstack([np.pad(row, ((0, 0), (0, width - row.shape[1]), (0, 0))) for row in rows])


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


def comparisons_of(streams: Mapping[str, Mapping[str, Any]], operator: str
                   ) -> Tuple[List[ImageComparison], List[RateComparison]]:
    """The comparisons of image streams, and those of the others.

    :param streams: {name: settings}, of those with an encoder
    :param operator: namespace of the operator
    """
    images, others = [], []
    for name, settings in streams.items():
        settings = {**settings, 'operator_topic': in_namespace(settings['operator_topic'], operator)}
        if settings['type'] == 'image':
            images.append(ImageComparison(name, settings))
        elif not settings['robot_topic'].startswith('~'):      # only robot_sender resolves those
            others.append(RateComparison(name, settings))
    return images, others


def report(title: str, lines: Sequence[str]) -> None:
    """Print at once: several robots report at the same time."""
    sys.stdout.write('\n'.join(['', title, *('  ' + line for line in lines), EXPECTED, '', '']))
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
    images, others = comparisons_of(classified(definitions).streams, operator)
    datagrams = DatagramCounts()
    rospy.Subscriber('/diagnostics', DiagnosticArray, lambda message: datagrams.add(
        status for status in map(as_status, message.status) if status is not None), queue_size=20)
    comparisons: List[Union[ImageComparison, RateComparison]] = [*images, *others]
    master, topics = parameters['operator_master'], {'/diagnostics', *(one.operator_topic for one in comparisons),
                                                     *(topics_to_robot or ())}

    def look() -> None:
        if master:
            _find_operator(master, operator, topics)
    _wait_for_images(images, look)
    with drive.connected(master, look) if drive else contextlib.nullcontext():
        for counts in (*comparisons, datagrams):
            counts.reset()
        elapsed = _drive_for(seconds, drive)
    lines = [comparison.line(elapsed) for comparison in comparisons] + [datagrams.line()]
    if drive:
        lines.append(drive.line())
    if path and any(comparison.pair for comparison in images):
        cv2.imwrite(path, side_by_side(images))
        lines.append('sent beside received: %s' % path)
    report('%sver %.0f s:' % (operator + ', o' if operator else 'O', elapsed), lines)
    if parameters['end_launch']:
        end_own_launch()
