# SPDX-License-Identifier: BSD-3-Clause
"""Decodes video in this process, for tests and experiments: its bytes are our own. Importing this module loads PyAV."""
import collections
import mmap
from typing import Counter, Optional

from smokebot_udp.arrays import UInt8Array
from smokebot_udp.codecs.video.decoder import Decoder
from smokebot_udp.codecs.video.decoder_memory import PLANES, SIZE, Answer, Status, layout
from smokebot_udp.codecs.video.decoder_pixels import pixels
from smokebot_udp.codecs.video.decoder_request import Request


class PlainDecoder:
    """As nodes.video_decoder.VideoDecoder."""

    def __init__(self) -> None:
        self.dropped: Counter[str] = collections.Counter()
        self._decoder, self._memory = Decoder(), mmap.mmap(-1, SIZE)

    def decode(self, request: Request) -> Optional[UInt8Array]:
        """Decode one image."""
        try:
            picture = self._decoder.decode(request)
        except ValueError:
            picture = None
        if picture is None:
            self.dropped['undecodable'] += 1
            return None
        for plane, data in zip(layout(picture.height, picture.width, picture.lines), picture.planes):
            self._memory[plane.start:plane.end] = data[:plane.end - plane.start]
        strides = (*picture.lines, 0, 0)[:PLANES]
        answer = Answer(0, Status.DECODED, picture.height, picture.width, strides)
        return pixels(memoryview(self._memory), answer, request)
