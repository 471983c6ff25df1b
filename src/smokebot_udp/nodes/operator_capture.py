# SPDX-License-Identifier: BSD-3-Clause
"""The operator's side of captures (doc/capture.md): the service ~capture fetches an original from the robot, publishes
it on `capture` beside its stream's topic, and saves it. ~capture_progress shows how far it is.
"""
import contextlib
import functools
import os
import random
import threading
import time
from typing import Any, Callable, Dict, Iterator, Mapping, Optional

import rospy

from ..capture import files
from ..capture.content import Captured, Refused, unpack
from ..capture.receiving import Receiving
from ..capture.sending import Piece
from ..limited_log import ERROR_PERIOD, logwarn
from ..monitoring.status import printable
from ..msg import CapturePiece, CaptureProgress, CaptureRequest
from ..srv import Capture, CaptureResponse
from ..streams.frame_prefix import add_prefix
from ..transport import Transport
from .common import Parameters
from .compiled_codec import CompiledCodec
from .opened import Part
from .operator_stream import OperatorStream
from .robot_captures import NAME, PIECES, REQUESTS

REQUEST_PERIOD, REPORT_RATE = 0.1, 8e3
"""Interval at which a request is repeated [s]; longer where its report of pieces takes longer at this rate [byte/s]."""

SILENCE = 20.0
"""Time without a piece after which a robot counts as not answering [s]."""

LAST_COPIES, LAST_SPACING = 3, 0.05
"""Number of copies of the message that a capture has ended, in case one is lost, and their interval [s]. More follow
where pieces still come."""

SCALE = 'counts_per_unit', 'zero', 'unit'
"""Settings of an image's view that give its values a unit."""

CAPTURED = 'sensor_msgs/Image', 'sensor_msgs/PointCloud2'
"""Types of what can be captured."""


class _Failed(Exception):
    """A capture failed: what is wrong, said of the stream."""


class OperatorCapture(Part):
    """Serves ~capture; lives as long as its node. One capture is fetched at a time.

    :param streams: {name: OperatorStream}
    :param codec: of layered images
    :param arrived: see OperatorLink
    """

    def __init__(self, transport: Transport, streams: Mapping[str, OperatorStream], codec: CompiledCodec,
                 arrived: Callable[..., None], parameters: Parameters) -> None:
        super().__init__()
        self._streams, self._codec = streams, codec
        self._prefix, self._timeout = parameters['frame_prefix'], parameters['capture_timeout']
        self._folder = os.path.expanduser(parameters['capture_directory'])
        self._fetching = threading.Lock()
        self._changed = threading.Condition()       # guards these
        self._id, self._receiving, self._came = 0, Receiving(), 0.0
        self._outputs: Dict[str, Any] = {}          # {stream: publisher}
        self._progress = rospy.Publisher('~capture_progress', CaptureProgress, queue_size=10, latch=True)
        self._requests = self._opened.topic(transport.publisher(REQUESTS, CaptureRequest, queue_size=1))
        self._opened.topic(transport.subscriber(PIECES, CapturePiece, self._take,
                                                arrived=functools.partial(arrived, NAME)))
        self._opened.callback(rospy.Service('~capture', Capture, self._serve).shutdown)

    # -- the transport's thread ------------------------------------------------------------------------

    def _take(self, message: Any) -> None:
        piece = Piece(message.size, message.order, message.number, message.length, bytes(message.data))
        with self._changed:
            if message.id and message.id == self._id:
                self._receiving.take(piece)
                self._came = time.monotonic()
                if self._receiving.whole is not None:
                    self._changed.notify_all()
                return
        self._requests.publish(CaptureRequest(id=message.id, done=True))

    # -- threads of the service ------------------------------------------------------------------------

    def _serve(self, asked: Any) -> Any:
        if not self._fetching.acquire(blocking=False):
            return CaptureResponse(False, 'another capture is being fetched', '')
        try:
            return self._capture(asked)
        except _Failed as failure:
            subject = "stream '%s'" % asked.stream
            text = '%s %s' % (subject, failure)
            self._show(asked.stream, text)
            logwarn(subject, failure, ERROR_PERIOD)
            return CaptureResponse(False, text, '')
        finally:
            self._fetching.release()

    def _capture(self, asked: Any) -> Any:
        """:raises _Failed: saying why there is no capture"""
        stream = self._streams.get(asked.stream)
        if stream is None or stream.assembler.MESSAGE._type not in CAPTURED:
            raise _Failed('cannot be captured: there is no such stream of type image or cloud')
        begun = time.monotonic()
        content = self._fetch(asked, stream)
        size, took = len(content), time.monotonic() - begun
        try:
            captured = self._prefixed(unpack(content, stream.assembler.MESSAGE))
        except (Refused, ValueError) as error:
            raise _Failed('cannot be captured: %s' % printable(str(error))) from None
        self._output(stream).publish(captured.message)
        path = self._save(asked, stream, captured)
        self._show(asked.stream, 'done', size)
        text = "stream '%s': captured in %.1f s, %.0f kB: %s" % (asked.stream, took, size / 1e3, path or 'not saved')
        rospy.loginfo('%s', text)
        return CaptureResponse(True, text, path)

    def _fetch(self, asked: Any, stream: OperatorStream) -> bytes:
        """What the robot sends.

        :raises _Failed: nothing, or not all, within the timeout
        """
        stamp = asked.stamp.to_nsec() or stream.last_stamp or 0
        request = CaptureRequest(
            id=random.SystemRandom().randint(1, 2 ** 32 - 1), stream=asked.stream,
            stamp=rospy.Time(*divmod(stamp, 10 ** 9)), x=asked.x, y=asked.y, width=asked.width, height=asked.height,
            layered=self._codec.ready())
        deadline = time.monotonic() + self._timeout
        with self._transfer(request):
            while True:
                with self._changed:
                    content = self._receiving.whole
                    request.received, request.order = self._receiving.received, self._receiving.order
                    if content is not None:
                        return content
                    self._check(deadline)
                self._requests.publish(request)
                self._show(asked.stream, 'receiving' if self._receiving.size else 'waiting')
                with self._changed:
                    self._changed.wait_for(lambda: self._receiving.whole is not None,
                                           max(REQUEST_PERIOD, len(request.received) / REPORT_RATE))

    @contextlib.contextmanager
    def _transfer(self, request: Any) -> Iterator[None]:
        """Take pieces of this request, and say afterwards that no more are needed."""
        with self._changed:
            self._id, self._receiving, self._came = request.id, Receiving(), time.monotonic()
        try:
            yield
        finally:
            with self._changed:
                self._id, dropped = 0, self._receiving.dropped
            if dropped:
                logwarn("stream '%s'" % request.stream, '%d impossible pieces of a capture were dropped' % dropped)
            for _ in range(LAST_COPIES):
                self._requests.publish(CaptureRequest(id=request.id, done=True))
                time.sleep(LAST_SPACING)

    def _check(self, deadline: float) -> None:
        """:raises _Failed: the robot is silent, or it is too late"""
        now, receiving = time.monotonic(), self._receiving
        if rospy.is_shutdown():
            raise _Failed('cannot be captured: this node ends')
        if now - self._came > min(SILENCE, self._timeout):
            raise _Failed('cannot be captured: %s' % (
                'the robot did not answer for %.0f s' % (now - self._came) if self._requests.get_num_connections()
                else 'no robot is connected'))
        if now > deadline:
            raise _Failed('cannot be captured: in %g s only %.0f of %.0f kB came; a region is smaller' % (
                self._timeout, receiving.held / 1e3, receiving.size / 1e3))

    def _show(self, name: str, state: str, size: Optional[int] = None) -> None:
        receiving = self._receiving
        held, whole = (receiving.held, receiving.size) if size is None else (size, size)
        message = CaptureProgress(stream=name, progress=held / whole if whole else 0.0, received=held, size=whole,
                                  state=state)
        message.header.stamp = rospy.Time.now()
        self._progress.publish(message)
        if whole and state == 'receiving':
            rospy.loginfo_throttle(2, "stream '%s': %.0f of %.0f kB of a capture" % (name, held / 1e3, whole / 1e3))

    def _output(self, stream: OperatorStream) -> Any:
        if stream.name not in self._outputs:
            # latched: who subscribes because the service has returned gets it, too
            self._outputs[stream.name] = rospy.Publisher(
                stream.topic.rsplit('/', 1)[0] + '/capture', stream.assembler.MESSAGE, queue_size=2, latch=True)
        return self._outputs[stream.name]

    def _prefixed(self, captured: Captured) -> Captured:
        pose = captured.pose
        return Captured(add_prefix(captured.message, self._prefix), None if pose is None else add_prefix(
            pose, self._prefix))

    def _save(self, asked: Any, stream: OperatorStream, captured: Captured) -> str:
        """The path of the file; empty: none is wanted.

        :raises _Failed: it cannot be written
        """
        if not self._folder:
            return ''
        message, settings = captured.message, stream.settings.current
        region = [value or getattr(message, name, 0) for name, value in (
            ('x', asked.x), ('y', asked.y), ('width', asked.width), ('height', asked.height))]
        partial = any((asked.x, asked.y, asked.width, asked.height))
        stamp = '%d.%09d' % (message.header.stamp.secs, message.header.stamp.nsecs)
        name = files.file_name(rospy.get_namespace().strip('/'), stream.name, stamp,
                               '-'.join(map(str, region)) if partial else '')
        more: Dict[str, Any] = {'stream': stream.name, 'topic': stream.topic}
        if partial:
            more['region'] = dict(zip(('x', 'y', 'width', 'height'), region))
        more.update({'scale': {key: settings[key] for key in SCALE}} if SCALE[0] in settings else {})
        try:
            end, content = files.file_of(message)
            return files.save(self._folder, name, end, content, files.described(message, captured.pose, more))
        except (OSError, ValueError) as error:
            raise _Failed('was captured and published, but is not saved in %s: %s' % (
                self._folder, error)) from None
