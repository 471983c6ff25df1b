# SPDX-License-Identifier: BSD-3-Clause
"""An operator's side of layered images for tests: segments of images, and what is published of them."""
from typing import Any, Dict, List, Tuple

import needs_numba  # noqa: F401
import numpy as np

from evaluation.offline_link import operator_side
from smokebot_udp.codecs.layered.image import encode
from smokebot_udp.codecs.layered.pieces import Layer, Plan, protect
from smokebot_udp.msg import LayeredSegment
from smokebot_udp.streams.segments import LAYERS
from smokebot_udp.udpros.frame import Frame

COUNT = 12
THRESHOLDS = 1, 4, 9
"""Number of datagrams that each layer of an image of `segments` needs: any one shows it, 9 of the 12 complete it."""

ERRORS = 200, 100, 0


def scene(seed: int = 0, dtype: Any = np.uint16, shape: Tuple[int, ...] = (48, 64)) -> Any:
    """A smooth image with noise, so that a lossless stream has several hundred bytes."""
    rows, columns = np.mgrid[:shape[0], :shape[1]]
    smooth = 100 + 50 * np.sin((rows + seed) / 9.0) + 40 * np.cos(columns / 7.0)
    if len(shape) == 3:
        smooth = smooth[..., np.newaxis] + np.arange(3) * 5
    noise = np.random.RandomState(seed).randint(0, 3, shape)
    return (smooth * (1 if dtype == np.uint8 else 60) + noise).clip(0, np.iinfo(dtype).max).astype(dtype)


def layers_of(size: int) -> List[Layer]:
    """Layers that hold a stream: 60 bytes, 300 bytes, the rest."""
    return [Layer(1, 60), Layer(4, 75), Layer(9, max(-(-(size - 360) // 9), 1))]


def segments(pixels: Any, seconds: int, encoding: str = 'mono16', classes: Any = None, depth_unit: float = 0.0,
             is_bigendian: bool = False) -> Any:
    """(12,) records of an image."""
    stream = encode(pixels, True, 1 << 20, classes)
    layers = layers_of(len(stream.data))
    pieces = protect(stream.data, Plan(COUNT, layers))
    frame = Frame(LayeredSegment, COUNT, {
        'header.frame_id': 6, 'encoding': len(encoding), 'thresholds': 3, 'sizes': 3, 'errors': 3,
        'data': pieces.shape[1]})
    records = frame.records
    records['header']['stamp']['secs'], records['header']['stamp']['nsecs'] = seconds, 5
    records['header']['frame_id'] = np.frombuffer(b'camera', np.uint8)
    records['height'], records['width'] = pixels.shape[:2]
    records['encoding'] = np.frombuffer(encoding.encode(), np.uint8)
    records['is_bigendian'], records['depth_unit'] = is_bigendian, depth_unit
    records['index'], records['count'] = np.arange(COUNT), COUNT
    records['thresholds'], records['sizes'] = THRESHOLDS, [layer.size for layer in layers]
    records['errors'], records['data'] = ERRORS, pieces
    return records


class Operator:
    """An assembler and what it publishes."""

    def __init__(self, **settings: Any) -> None:
        self.assembler, self.settings = operator_side('image', **settings)

    def __call__(self, records: Any, now: float, part: str = LAYERS) -> List[Any]:
        """What is published at once of some segments."""
        self.assembler.receive(records, np.ones(len(records), bool), now, part)
        return self.poll(now)

    def poll(self, now: float) -> List[Any]:
        results = []
        finished = self.assembler.poll(now)
        while finished is not None:
            assembled = self.assembler.assemble(finished, self.settings, False, now)
            if assembled is not None:
                self.assembler.settle(finished, assembled, self.settings, now)
                results.append(assembled)
            finished = self.assembler.poll(now)
        return results

    @property
    def dropped(self) -> Dict[str, int]:
        return {reason: count for reason, count in self.assembler.dropped.items() if count}


def pixels_of(assembled: Any, dtype: Any = np.uint16) -> Any:
    message = assembled.message
    return np.frombuffer(message.data, dtype).reshape(message.height, message.width, -1).squeeze()


def rms(first: Any, second: Any) -> float:
    return float(np.sqrt(np.mean((first.astype(float) - second) ** 2)))
