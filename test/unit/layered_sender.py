# SPDX-License-Identifier: BSD-3-Clause
"""A robot's side of layered images for tests: images, the encoder, and what its datagrams show."""
from typing import Any, List, Mapping, Optional, Sequence

import needs_numba  # noqa: F401
import numpy as np
from genpy import Time
from sensor_msgs.msg import Image

from evaluation.linked_encoder import LinkedEncoder
from smokebot_udp.codecs.layered.image import Decoded, decode
from smokebot_udp.codecs.layered.pieces import Layer, Restorer
from smokebot_udp.mission.parameters import check
from smokebot_udp.mission.settings import Settings
from smokebot_udp.streams.air import Air, LossBeliefs
from smokebot_udp.streams.image.encoder import ImageEncoder
from smokebot_udp.streams.outlook import Outlook
from smokebot_udp.udpros.datagram import OVERHEAD

DATAGRAM = 1472
NO_LOSS = Outlook(Air({0.0: 1.0}, None, True))
BAD = Outlook(Air({0.0: 0.2, 0.2: 0.5, 0.5: 0.3}, None, True))


def nothing_lost() -> Outlook:
    """What is expected after 6 s of reports of 60 datagrams each."""
    beliefs = LossBeliefs()
    for number in range(60):
        beliefs.add(60, 60, number / 10)
    return Outlook(beliefs.air(6.0))


def photograph(height: int = 96, width: int = 128, channels: int = 1, high: float = 255.0) -> Any:
    """Smooth, with an edge and some noise: (height, width[, channels]) float."""
    rows, columns = np.mgrid[:height, :width]
    parts = [0.5 + 0.3 * np.sin(rows / 17 + k) * np.cos(columns / 23) - 0.2 * (columns > 60 + 5 * k)
             + 0.004 * np.random.RandomState(k).randn(height, width) for k in range(channels)]
    return high * np.clip(np.dstack(parts) if channels > 1 else parts[0], 0, 1)


def image(pixels: Any, encoding: str, seconds: int = 1, big: bool = False) -> Any:
    pixels = np.ascontiguousarray(pixels)
    message = Image(height=pixels.shape[0], width=pixels.shape[1], encoding=encoding, step=pixels.strides[0],
                    data=pixels.tobytes(), is_bigendian=big)
    message.header.stamp, message.header.frame_id = Time(seconds, 7), 'lens'
    return message


def settings(granted: Optional[Mapping[str, Any]] = None, **changes: Any) -> Settings:
    return Settings(check({'robot_topic': '/in', 'coding': 'layered', **changes}, ImageEncoder.PARAMETERS),
                    granted or {})


def encoder(of: Settings, outlook: Outlook = NO_LOSS, **options: Any) -> LinkedEncoder:
    return LinkedEncoder(ImageEncoder(of.requested, **options), outlook=outlook)


def segments(frames: Sequence[Any]) -> List[Any]:
    return [frame.message_class().deserialize(row[OVERHEAD:].tobytes()) for frame in frames for row in frame.rows]


def received(parts: Sequence[Any], arrived: Sequence[int]) -> Any:
    """(Decoded, error byte of the layers) of some segments of an image."""
    first = parts[0]
    restorer = Restorer(first.count, [Layer(*layer) for layer in zip(first.thresholds, first.sizes)])
    assert restorer.add(np.array([parts[i].index for i in arrived]),
                        np.array([list(parts[i].data) for i in arrived], np.uint8)).all()
    colours = first.encoding in ('bgr8', 'rgb8', '8UC3')
    wide = first.encoding in ('mono16', '16UC1', '32FC1')
    decoded = decode(restorer.restored(), first.height, first.width, 3 if colours else 1, 2 if wide else 1)
    return decoded, first.errors[restorer.restorable - 1] if restorer.restorable else None


def rms(decoded: Decoded, pixels: Any) -> float:
    return float(np.sqrt(((decoded.pixels.astype(float) - pixels) ** 2).mean()))


CASES = {
    'mono8': photograph().astype(np.uint8), 'mono16': (7000 + photograph(high=2000)).astype(np.uint16),
    'bgr8': photograph(channels=3).astype(np.uint8),
}
