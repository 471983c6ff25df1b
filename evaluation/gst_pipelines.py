# SPDX-License-Identifier: BSD-3-Clause
"""GStreamer's pipelines of `bench live`: what a user would send the camera with instead, its bit rate set by hand.

x264 as a robot's user would set it: no delay, slices of a datagram each, and refresh without large images.
"""
from typing import Callable, Dict, NamedTuple

from .live_clip import HEIGHT, WIDTH

PORT, SPARE = 5004, 0.85
"""The receiver's; how much of the link's rate is used, heads and parity included: images differ in size."""

RTP_HEADS, SLICE = 40.0, 1300
"""IPv4, UDP and RTP; longest slice [byte]."""

LATENCY = 50
"""Of the jitter buffer [ms]."""

RAW = 'video/x-raw,format=GRAY8,width=%d,height=%d,framerate=10/1' % (WIDTH, HEIGHT)
CODED = ('appsrc name=camera is-live=true format=time caps=%s ! videoconvert ! x264enc name=encoder tune=zerolatency '
         'speed-preset=veryfast bitrate={bit_rate} key-int-max=20 intra-refresh=true vbv-buf-capacity=200 '
         'option-string="slice-max-size=%d"' % (RAW, SLICE))
PAYLOADED = ' ! rtph264pay pt=96 timestamp-offset=0 config-interval=-1 mtu=1400 aggregate-mode=zero-latency'
TO_OPERATOR = ' ! udpsink host={operator} port=%d sync=false async=false' % PORT
RTP_CAPS = 'application/x-rtp,media=video,clock-rate=90000,encoding-name=H264,payload=96'
FROM_ROBOT = 'udpsrc port=%d buffer-size=1000000 caps="%s"' % (PORT, RTP_CAPS)
DECODED = (' ! avdec_h264 output-corrupt=true max-threads=1 ! videoconvert ! video/x-raw,format=GRAY8 '
           '! appsink name=screen sync=false max-buffers=10')
DEPAYLOADED = ' ! rtph264depay name=depay' + DECODED


class Way(NamedTuple):
    """A way of sending by GStreamer."""
    title: str
    sender: str
    """Pipeline, with {bit_rate} [kbit/s] and {operator}."""
    receiver: str
    """Pipeline, with {robot}."""
    more: Callable[[float], float]
    """What it sends for each byte of RTP at this loss: parity, or what is sent again."""


WAYS: Dict[str, Way] = {
    'gst': Way('GStreamer H.264/RTP', CODED + PAYLOADED + TO_OPERATOR,
               FROM_ROBOT + ' ! rtpjitterbuffer latency=%d do-lost=true' % LATENCY + DEPAYLOADED, lambda loss: 1.0),
}


def bit_rate(way: Way, rate: float, loss: float) -> int:
    """What the encoder is set to, so that all that is sent takes SPARE of the link [kbit/s].

    :param rate: of the link [bit/s]
    :param loss: 0..1
    """
    return round(SPARE * rate / 1e3 / way.more(loss) / (1 + RTP_HEADS / SLICE))
