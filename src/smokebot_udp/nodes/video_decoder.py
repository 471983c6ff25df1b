# SPDX-License-Identifier: BSD-3-Clause
"""Decodes the video of one stream in a process of its own, which is replaced when it dies, hangs or lies."""
import collections
import threading
import time
from typing import Counter, Optional, Sequence

from ..arrays import UInt8Array
from ..budget import Budget
from ..codecs.video.decoder_memory import Answer, Status
from ..codecs.video.decoder_pixels import pixels
from ..codecs.video.decoder_request import Request
from .decoder_child import BROKEN, PROGRAM, ChildError, DecoderChild
from .logging import log_error

IMAGE_TIMEOUT = 0.3
"""For an image, which takes some ms [s]."""

START_TIMEOUT = 5.0
"""For the process, which takes some 0.2 s [s]."""

BURST, PERIOD = 3, 2.0
"""So many processes are started at once, and then one each period: what comes from the air may kill each one [s]."""

BROKEN_PERIOD = 60.0
"""Where PyAV cannot be loaded it is tried again after this time [s]."""


class VideoDecoder:
    """Decodes the images of one stream, in order. The process starts with the first image.

    One thread decodes, and lives as long as the decoder: the kernel kills the process when it ends. Others may read
    `dropped` and call `close`.

    :param name: of the stream, for the log
    :param program: that the process runs
    """

    def __init__(self, name: str, program: Sequence[str] = PROGRAM) -> None:
        self.dropped: Counter[str] = collections.Counter()
        """{reason: count} of the images that were not decoded."""
        self.broken = False
        """Whether PyAV cannot be loaded."""
        self._program = program
        self._log = log_error("stream '%s'" % name)
        self._starts = Budget(BURST, PERIOD)
        self._not_before = 0.0              # the next process is started [s]
        self._decoding = threading.Lock()
        self._lock = threading.Lock()       # of what `close` and the decoding thread both change
        self._child: Optional[DecoderChild] = None
        self._closed = False

    @property
    def pid(self) -> Optional[int]:
        """Id of the decoder's process; None: there is none."""
        child = self._child
        return None if child is None else child.pid

    def decode(self, request: Request) -> Optional[UInt8Array]:
        """Decode one image. It takes IMAGE_TIMEOUT at most; longer while the process starts or waits for the processor.

        :return: (height, width) uint8, or (height, width, 3) uint8: blue, green and red; None: there is no image, which
            is counted in `dropped`, and perhaps nothing that the next ones can be predicted from
        """
        try:
            request.check()
        except ValueError:
            self.dropped['impossible image'] += 1
            return None
        with self._decoding:
            return self._decode(request)

    def close(self) -> None:
        """End the process; a `decode` in another thread returns at once."""
        with self._lock:
            self._closed = True
            if self._child is not None:
                self._child.kill()
        with self._decoding:
            if self._child is not None:
                self._child.close()
                self._child = None

    def _decode(self, request: Request) -> Optional[UInt8Array]:
        child = self._running()
        if child is None:
            self.dropped['no decoder'] += 1
            return None
        try:
            child.await_ready(START_TIMEOUT)
            answer = child.decode(request, IMAGE_TIMEOUT)
            if answer.status == Status.DECODED:
                return _copied(child, answer, request)
            self.dropped['undecodable' if answer.status == Status.NOTHING else 'unfit'] += 1
        except ChildError as error:
            self._replace(error)
        return None

    def _running(self) -> Optional[DecoderChild]:
        """The process, started if it may be; None: not now."""
        with self._lock:
            now = time.monotonic()
            if self._child is None and not self._closed and now >= self._not_before and self._starts.take(now):
                try:
                    self._child = DecoderChild(self._program)
                except OSError as error:
                    self._not_before = now + BROKEN_PERIOD
                    self._log(error)
            return self._child

    def _replace(self, error: ChildError) -> None:
        """Kill the process, and start the next one at once: it loads its libraries until the next image."""
        with self._lock:
            child, self._child = self._child, None
            if child is not None:
                child.close()
            if self._closed:
                return
            self.broken = error.reason == BROKEN
            if self.broken:
                self._not_before = time.monotonic() + BROKEN_PERIOD
        self.dropped[error.reason] += 1
        self._log(error)
        self._running()


def _copied(child: DecoderChild, answer: Answer, request: Request) -> UInt8Array:
    """The pixels of an answer.

    :raises ChildError: they are impossible, which the process itself has checked
    """
    try:
        return pixels(child.memory, answer, request)
    except ValueError as error:
        raise ChildError('decoder nonsense', str(error)) from None
