# SPDX-License-Identifier: BSD-3-Clause
"""GStreamer's pipelines of `bench live`: what a user would send the camera with instead, its bit rate set by hand.

x264 as a robot's user would set it: no delay, slices of a datagram each, and refresh without large images. Alone, with
parity (RFC 5109), with retransmission (RFC 4588), and over SRT.
"""
from typing import Dict, NamedTuple

from .live_clip import HEIGHT, WIDTH

PACKAGES = ('gstreamer1.0-plugins-base', 'gstreamer1.0-plugins-good', 'gstreamer1.0-plugins-bad',
            'gstreamer1.0-plugins-ugly', 'gstreamer1.0-libav', 'gir1.2-gst-plugins-base-1.0', 'python3-gst-1.0')
"""Debian packages that the pipelines need."""

PORT, REPORT_PORT, REPLY_PORT = 5004, 5005, 5006
"""Ports of media and of the sender's reports at the operator, and of the receiver's reports at the robot."""

SPARE = 0.85
"""Part of the link's rate that is used, headers, parity and retransmissions included: images differ in size."""

SLICE, RTP_HEADS = 1300, 40.0
"""Maximum length of a slice, and length of the headers of IPv4, UDP and RTP [byte]."""

LEAST_RATE = 30
"""Minimum bit rate of the encoder [kbit/s]."""

PARITY = 0.25
"""Ratio of parity packets to media packets."""
MPEG_TS, TABLES = 1.1, 30.0
"""Size in MPEG-TS and SRT of a byte, as headers take 44 of 1316 and cells of 188 are not full; and rate of the tables
that MPEG-TS repeats [kbit/s]."""

LATENCY, REPEATED_LATENCY = 50, 120
"""Latency of the receiver, and that where lost packets are sent again, which takes a round trip or two [ms]."""

CAPTIONED = 'captioned'
"""Name of the element that images pass whose numbers are captions, see gst_peer. A sender that needs them has one of
this name."""

RAW = 'video/x-raw,format=GRAY8,width=%d,height=%d,framerate=10/1' % (WIDTH, HEIGHT)
CODED = ('appsrc name=camera is-live=true format=time caps=%s ! videoconvert ! x264enc tune=zerolatency '
         'speed-preset=veryfast bitrate={bit_rate} key-int-max=20 intra-refresh=true vbv-buf-capacity=200 '
         'option-string="slice-max-size=%d"' % (RAW, SLICE))
PAYLOADED = CODED + ' ! rtph264pay pt=96 timestamp-offset=0 config-interval=-1 mtu=1400 aggregate-mode=zero-latency'
CAPS = 'application/x-rtp,media=video,clock-rate=90000,encoding-name=H264,payload=96'
DECODED = (' ! avdec_h264 output-corrupt=true max-threads=1 ! videoconvert ! video/x-raw,format=GRAY8 '
           '! appsink name=screen sync=false max-buffers=10')
DEPAYLOADED = ' ! rtph264depay name=depay' + DECODED
TO_OPERATOR = ' ! udpsink host={operator} port=%d sync=false async=false'
FROM = 'udpsrc port=%d buffer-size=1000000'
RECEIVED = FROM % PORT + ' caps="%s"' % CAPS
REPEATS = 'payload-type-map="application/x-rtp-pt-map,96=(uint)97"'
REPORTED = ' rtp.send_rtcp_src ! udpsink host={%s} port=%d sync=false async=false ' + FROM + ' ! rtp.recv_rtcp_sink '


class Way(NamedTuple):
    """A way of sending by GStreamer."""
    title: str
    sender: str
    """Pipeline, with {bit_rate} [kbit/s] and {operator}."""
    receiver: str
    """Pipeline, with {robot}."""
    expansion: float
    """What is sent for each byte of the encoder's."""
    repeats: bool = False
    """Whether what is lost is sent again."""
    beside: float = 0.0
    """What is sent beside [kbit/s]."""


WAYS: Dict[str, Way] = {
    'gst': Way('H.264/RTP', PAYLOADED + TO_OPERATOR % PORT,
               RECEIVED + ' ! rtpjitterbuffer latency=%d do-lost=true' % LATENCY + DEPAYLOADED,
               1 + RTP_HEADS / SLICE),
    'fec': Way('H.264/RTP, ULPFEC %d %%' % (100 * PARITY),
               PAYLOADED + ' ! rtpulpfecenc pt=122 percentage=%d' % (100 * PARITY) + TO_OPERATOR % PORT,
               RECEIVED + ' ! rtpstorage name=storage size-time=250000000 ! rtpssrcdemux ! ' + CAPS
               + ' ! rtpjitterbuffer latency=%d do-lost=true ! rtpulpfecdec name=parity pt=122' % LATENCY + DEPAYLOADED,
               (1 + PARITY) * (1 + RTP_HEADS / SLICE)),
    'rtx': Way('H.264/RTP, retransmission',
               'rtpsession name=rtp rtp-profile=avpf ' + PAYLOADED + ' ! rtprtxsend %s ! rtp.send_rtp_sink ' % REPEATS
               + 'rtp.send_rtp_src' + TO_OPERATOR % PORT + REPORTED % ('operator', REPORT_PORT, REPLY_PORT),
               'rtpsession name=rtp rtp-profile=avpf ' + RECEIVED + ' ! rtp.recv_rtp_sink rtp.recv_rtp_src ! '
               'rtprtxreceive %s ! rtpssrcdemux ! rtpjitterbuffer latency=%d do-lost=true do-retransmission=true' % (
                   REPEATS, REPEATED_LATENCY) + DEPAYLOADED + REPORTED % ('robot', REPLY_PORT, REPORT_PORT),
               1 + RTP_HEADS / SLICE, True),
    # one image is one PES packet: to say so saves the parser's wait for the next image
    'srt': Way('H.264/MPEG-TS over SRT', CODED + ' ! identity name=%s ! h264parse ! mpegtsmux alignment=7 ' % CAPTIONED
               + '! srtsink uri=srt://{operator}:%d?mode=caller latency=%d' % (PORT, REPEATED_LATENCY),
               'srtsrc uri=srt://:%d?mode=listener latency=%d ! tsdemux ! capssetter replace=true '
               'caps=video/x-h264,stream-format=byte-stream,alignment=au ! identity name=%s' % (
                   PORT, REPEATED_LATENCY, CAPTIONED) + DECODED,
               MPEG_TS, True, TABLES),
}


def bit_rate(way: Way, rate: float, loss: float) -> int:
    """What the encoder is set to, so that all that is sent takes SPARE of the link [kbit/s].

    :param rate: of the link [bit/s]
    :param loss: 0..1
    """
    sent_once = SPARE * rate / 1e3 * (1 - loss if way.repeats else 1) - way.beside
    return max(round(sent_once / way.expansion), LEAST_RATE)
