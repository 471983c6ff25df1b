# SPDX-License-Identifier: BSD-3-Clause
"""One end of a GStreamer pipeline, see gst_pipelines: sends the clip, or records what arrives.

    python3 -m evaluation.gst_peer send PIPELINE
    python3 -m evaluation.gst_peer receive PIPELINE FILE

The sender writes [number, stamp [s]] of each image as a line of JSON, the receiver [number or null, arrival [s], index
in the file].
"""
import bisect
import json
import struct
import sys
import threading
import time
from typing import Any, List, Optional, Tuple

import gi

gi.require_version('Gst', '1.0')
from gi.repository import Gst  # noqa: E402

from .live_camera import moments  # noqa: E402
from .live_clip import HEIGHT, WIDTH, Clip  # noqa: E402
from .live_recorder import ImageFile  # noqa: E402
from .video_clips import RATE  # noqa: E402

RTP_CLOCK = 90000
"""Of video: ticks of its time stamps in a second (RFC 6184)."""

PULL = 100_000_000
"""How long to wait for an image before the end is looked for [ns]."""

MAX_STAMPS = 200
"""Images whose numbers are kept until they are decoded."""


def run(text: str) -> Any:
    """A pipeline that plays; an error ends the process."""
    Gst.init(None)
    pipeline = Gst.parse_launch(text)
    pipeline.set_state(Gst.State.PLAYING)

    def watch() -> None:
        message = pipeline.get_bus().timed_pop_filtered(Gst.CLOCK_TIME_NONE, Gst.MessageType.ERROR)
        print(message.parse_error(), file=sys.stderr, flush=True)
        sys.exit(1)
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
        source.emit('push-buffer', buffer)
        print(json.dumps([number, moment]), flush=True)


class Numbers:
    """Which image of the clip a decoded one is: the sender's time stamp in its RTP packets tells."""

    def __init__(self, depayloader: Any) -> None:
        self._known: List[Tuple[int, int]] = []     # (presentation time [ns], number), in order
        depayloader.get_static_pad('sink').add_probe(Gst.PadProbeType.BUFFER, self._note)

    def _note(self, pad: Any, info: Any) -> Any:
        buffer = info.get_buffer()
        stamp = struct.unpack('>I', buffer.extract_dup(4, 4))[0]
        entry = (buffer.pts, round(stamp * RATE / RTP_CLOCK))
        if entry not in self._known[-1:]:
            bisect.insort(self._known, entry)
            del self._known[:-MAX_STAMPS]
        return Gst.PadProbeReturn.OK

    def of(self, presented: int) -> Optional[int]:
        """The number of an image by its presentation time [ns]; None: unknown."""
        at = bisect.bisect_left(self._known, (presented, -1))
        return min(self._known[max(0, at - 1):at + 1], key=lambda entry: abs(entry[0] - presented),
                   default=(0, None))[1]


def receive(text: str, path: str) -> None:
    """Record the images that are decoded."""
    pipeline, file = run(text), ImageFile(path)
    numbers = Numbers(pipeline.get_by_name('depay'))
    screen = pipeline.get_by_name('screen')
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
