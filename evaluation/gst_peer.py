# SPDX-License-Identifier: BSD-3-Clause
"""One end of a GStreamer pipeline, see gst_pipelines: sends the clip, or records what arrives.

    python3 -m evaluation.gst_peer send PIPELINE
    python3 -m evaluation.gst_peer receive PIPELINE FILE

The sender writes [number, stamp [s]] of each image as a line of JSON; the receiver `null` when it listens, and [number
or null, arrival [s], index in the file] of each image.

Which image of the clip a decoded one is, its RTP packets say by the sender's time stamp. Elsewhere, each image carries
its number as if it were a caption.
"""
import bisect
import json
import os
import re
import struct
import sys
import threading
import time
from typing import Any, Callable, List, Optional, Tuple

import gi

gi.require_version('Gst', '1.0')
gi.require_version('GstVideo', '1.0')
from gi.repository import Gst, GstVideo  # noqa: E402

from .gst_pipelines import CAPTIONED  # noqa: E402
from .live_camera import moments  # noqa: E402
from .live_clip import HEIGHT, WIDTH, Clip  # noqa: E402
from .live_recorder import ImageFile  # noqa: E402
from .video_clips import RATE  # noqa: E402

RTP_CLOCK = 90000
"""Clock rate of video in RTP: ticks of its time stamps in a second (RFC 6184) [Hz]."""

PULL = 100_000_000
"""Time to wait for an image before the end is looked for [ns]."""

CAPTION = re.compile(rb'GA94\x03..(\d{6})', re.DOTALL)
"""A caption of six digits in H.264 (ATSC A/53, part 4)."""

MAX_STAMPS = 200
"""Maximum number of images whose numbers are kept until they are decoded."""


def run(text: str) -> Any:
    """A pipeline that plays; an error ends the process."""
    Gst.init(None)
    pipeline = Gst.parse_launch(text)
    parity = pipeline.get_by_name('parity')
    if parity is not None:      # which no text can say
        parity.set_property('storage', pipeline.get_by_name('storage').get_property('internal-storage'))
    pipeline.set_state(Gst.State.PLAYING)

    def watch() -> None:
        message = pipeline.get_bus().timed_pop_filtered(Gst.CLOCK_TIME_NONE, Gst.MessageType.ERROR)
        print(message.parse_error(), file=sys.stderr, flush=True)
        os._exit(1)
    threading.Thread(target=watch, daemon=True).start()
    return pipeline


def send(text: str) -> None:
    """Push the clip's images as they are taken."""
    pipeline, clip = run(text), Clip()
    source = pipeline.get_by_name('camera')
    for number, moment in moments(lambda: False):
        buffer = Gst.Buffer.new_wrapped(clip.image(number).tobytes())
        buffer.pts = round(number * Gst.SECOND / RATE)
        buffer.duration = round(Gst.SECOND / RATE)
        if CAPTIONED in text:
            GstVideo.buffer_add_video_caption_meta(buffer, GstVideo.VideoCaptionType.CEA708_RAW, b'%06d' % number)
        source.emit('push-buffer', buffer)
        print(json.dumps([number, moment]), flush=True)


def number_in_rtp(buffer: Any) -> Optional[int]:
    """The number of the image that a packet is a part of."""
    return round(struct.unpack('>I', buffer.extract_dup(4, 4))[0] * RATE / RTP_CLOCK)


def number_in_caption(buffer: Any) -> Optional[int]:
    """The number that an image carries; None: it was lost."""
    found = CAPTION.search(buffer.extract_dup(0, buffer.get_size()))
    return int(found.group(1)) if found else None


class Numbers:
    """Which images of the clip pass an element, by their presentation time.

    :param number_of: f(buffer) -> number or None
    """

    def __init__(self, element: Any, number_of: Callable[[Any], Optional[int]]) -> None:
        self._known: List[Tuple[int, int]] = []     # (presentation time [ns], number), in order
        self._number_of = number_of
        element.get_static_pad('sink').add_probe(Gst.PadProbeType.BUFFER, self._note)

    def _note(self, pad: Any, info: Any) -> Any:
        buffer = info.get_buffer()
        number = self._number_of(buffer)
        if number is not None and (buffer.pts, number) not in self._known[-1:]:
            bisect.insort(self._known, (buffer.pts, number))
            del self._known[:-MAX_STAMPS]
        return Gst.PadProbeReturn.OK

    def of(self, presented: int) -> Optional[int]:
        """The number of the image whose presentation time is closest to this one [ns]; None: there is none."""
        at = bisect.bisect_left(self._known, (presented, -1))
        return min(self._known[max(0, at - 1):at + 1], key=lambda entry: abs(entry[0] - presented),
                   default=(0, None))[1]


def receive(text: str, path: str) -> None:
    """Record the images that are decoded."""
    pipeline, file = run(text), ImageFile(path)
    of_captions = pipeline.get_by_name(CAPTIONED)
    numbers = (Numbers(of_captions, number_in_caption) if of_captions is not None else
               Numbers(pipeline.get_by_name('depay'), number_in_rtp))
    screen = pipeline.get_by_name('screen')
    print('null', flush=True)
    while True:
        sample = screen.emit('try-pull-sample', PULL)
        if sample is not None:
            arrival, buffer = time.time(), sample.get_buffer()
            number = numbers.of(buffer.pts)
            index = file.append(buffer.extract_dup(0, HEIGHT * WIDTH))
            print(json.dumps([number, arrival, index]), flush=True)


if __name__ == '__main__':
    if sys.argv[1] == 'send':
        send(sys.argv[2])
    else:
        receive(*sys.argv[2:4])
