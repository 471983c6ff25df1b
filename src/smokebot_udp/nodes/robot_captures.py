# SPDX-License-Identifier: BSD-3-Clause
"""The robot's side of captures: sends operators the originals that they ask for (doc/capture.md).

Pieces leave as a stream of the outbox: they are paced with all others, and link reports name them. Its share of the
link is `capture_share`, and whatever the other streams leave over.
"""
import collections
import time
from typing import Any, Dict, Mapping, Union

import numpy as np
import rospy

from ..capture.content import cropped, pack, refusal
from ..capture.sending import Piece, piece_length
from ..capture.transfers import MAX_RATE, Batch, Load, Request, Transfers
from ..congestion.controller import Demand
from ..congestion.operating_points import OperatingPoint
from ..frame_names import unknown_transform
from ..limited_log import ERROR_PERIOD, logwarn
from ..msg import CapturePiece, CaptureRequest
from ..streams.image.source import raw_image
from ..streams.segments import room
from ..traffic import BULK, ECT
from ..udpros.datagram import IP_UDP_HEADERS
from ..udpros.frame import Frame
from .compiled_codec import CompiledCodec
from .level_frame import TransformLookup
from .logging import log_error
from .opened import Part
from .robot_stream import RobotLink, RobotStream
from .worker import DeadlineWorker

REQUESTS, PIECES = '/smokebot_udp/capture/request', '/smokebot_udp/capture/pieces'
"""Topics on the wire."""

NAME = '~captures'
"""Name of the stream of pieces in link reports and the packet scheduler. No stream of streams.yaml has such a name."""

ODOMETRY_FRAME = 'odom'
"""The pose is that in the fixed frame of streams.yaml, or in this one of REP-105 where tf does not know that one."""

BATCH_DURATION, MAX_BATCH = 0.004, 16
"""Maximum time for which pieces that leave together occupy the link, unless it is a single one [s], and their maximum
number."""

DURATION = 2.0
"""Approximate duration of a transfer on a link with nothing else to send [s]."""


class RobotCaptures(Part):
    """Serves captures; lives as long as its node.

    :param streams: {name: RobotStream}
    :param lookup: of transforms
    :param codec: of layered images
    :param share: of the link, 0..1, while there is a transfer
    :param fixed_frame: of streams.yaml
    """

    def __init__(self, link: RobotLink, streams: Mapping[str, RobotStream], lookup: TransformLookup,
                 codec: CompiledCodec, share: float, fixed_frame: str) -> None:
        super().__init__()
        self._link, self._streams = link, streams
        self._frames = tuple(collections.OrderedDict.fromkeys((fixed_frame, ODOMETRY_FRAME)))
        self._lookup, self._codec, self._share = lookup, codec, share
        self._transfers = Transfers()
        self._worker: DeadlineWorker[Union[Load, Batch]] = DeadlineWorker(
            'captures', self._transfers.poll, lambda: self._transfers.deadline(time.monotonic()), self._work,
            log_error('captures'))
        self._publisher = self._opened.topic(link.transport.publisher(PIECES, CapturePiece, tos=BULK | ECT))
        self._opened.callback(link.outbox.drop, NAME)
        self._opened.started(self._worker)
        self._opened.topic(link.transport.subscriber(REQUESTS, CaptureRequest, self._receive, queue_size=20))
        if any(stream.settings.current.requested.get('history') for stream in streams.values()):
            lookup.prepare()

    def demands(self, capacity: float) -> Dict[str, Demand]:
        """What the transfers would send, as a stream beside the others; any thread.

        :param capacity: of the link; 0: unknown [byte/s]
        """
        with self._worker.changing():
            left = self._transfers.left
        if not left:
            return {}
        least = self._share * capacity
        most = max(least, min(left / DURATION, MAX_RATE))
        points = [OperatingPoint({}, rate) for rate in (least, most)]
        return {NAME: Demand(points, weight=0.0, min_bitrate=least)}

    # -- the transport's thread ------------------------------------------------------------------------

    def _receive(self, message: Any) -> None:
        operator = message._connection_header['callerid']
        with self._worker.changing():
            if message.done:
                self._transfers.end(operator, message.id)
                return
            request = Request(message.id, message.stream, message.stamp.to_nsec(),
                              (message.x, message.y, message.width, message.height), message.layered)
            self._transfers.request(operator, request, bytes(message.received), message.order, time.monotonic())

    # -- the worker's thread ---------------------------------------------------------------------------

    def _work(self, work: Union[Load, Batch]) -> None:
        if isinstance(work, Load):
            self._load(work)
        else:
            self._send(work)
        with self._worker.changing():
            self._transfers.batch = self._batch()

    def _load(self, load: Load) -> None:
        usual, most = (room(CapturePiece, size) for size in (
            self._link.datagram_size, self._link.transport.room))
        try:
            content = self._content(load.request)
            length = piece_length(len(content), usual, most)
            rospy.loginfo("stream '%s': %s fetches an original, %.0f kB", load.request.stream, load.operator,
                          len(content) / 1e3)
        except Exception as error:      # whatever it is, the operator must not wait in silence
            reason = str(error) if isinstance(error, ValueError) else 'the robot cannot send it: %s: %s' % (
                type(error).__name__, error)
            logwarn('a capture of %s is refused' % load.operator, reason, ERROR_PERIOD)
            content = refusal(reason)
            length = piece_length(len(content), usual, most)
        with self._worker.changing():
            self._transfers.loaded(load, content, length, time.monotonic())

    def _content(self, request: Request) -> bytes:
        """:raises ValueError: saying why there is none"""
        if request.stream not in self._streams:
            raise ValueError('the robot has no stream %.80r' % request.stream)
        if self._link.histories is None:
            raise ValueError('the robot keeps no originals')
        found = self._link.histories.find(request.stream, request.stamp)
        message = cropped(raw_image(found.message), request.region)
        pose = self._lookup.pose(self._frames, message.header)
        if pose is None:
            logwarn("stream '%s'" % request.stream, unknown_transform(
                message.header.frame_id, ' or '.join(self._frames), 'a capture has no pose'), ERROR_PERIOD)
        return pack(message, pose, request.layered and self._codec.ready())

    def _send(self, batch: Batch) -> None:
        self._link.outbox.put(NAME, self._publisher, [as_frame(batch.id, piece) for piece in batch.pieces],
                              only=batch.operator)
        self._link.outbox.await_rest(NAME, whole=True)

    def _batch(self) -> int:
        rate = self._link.outbox.rate
        size = self._link.datagram_size + IP_UDP_HEADERS
        return MAX_BATCH if rate is None else max(1, min(MAX_BATCH, int(BATCH_DURATION * rate / size)))


def as_frame(id_: int, piece: Piece) -> Frame:
    """A piece as a datagram.

    :param id_: of the capture
    """
    frame = Frame(CapturePiece, 1, {'data': len(piece.data)})
    record = frame.records[0]
    record['id'] = id_
    for name in ('size', 'order', 'number', 'length'):
        record[name] = getattr(piece, name)
    record['data'] = np.frombuffer(piece.data, np.uint8)
    return frame
