# SPDX-License-Identifier: BSD-3-Clause
"""Operating points of each kind of stream: settings and their cost, from the cheapest to those requested.

Four steps halve the byte rate. Bandwidth that is left over between two steps goes to other streams, or into refinement.
"""
import math
from typing import Any, Callable, Dict, List, NamedTuple

from ..units import KBIT

STEP = 2 ** 0.25
"""Ratio of the costs of two neighbouring operating points, about."""

TOLERANCE = 1e-9
"""For rounding errors."""


LATE_RATE = 4.0
"""The least images come down to this rate where they cannot come as often as they should: late images are better than
none. With 1 Hz images were missing for 1 to 2 s where one of two paths was cut [Hz]."""


class OperatingPoint(NamedTuple):
    """Settings of a stream, and what they cost."""
    settings: Dict[str, Any]
    """As streams.yaml names them."""
    cost: float
    """Byte rate on the link [byte/s]."""


def image_points(rate: float, subimages: int, per_datagram: int, datagram: int, degradation_preference: float = 0.75,
                 least_rate: float = 2.0) -> List[OperatingPoint]:
    """Operating points of images: fewer subimages, and fewer images.

    :param rate: of images, as requested or of the source [Hz]
    :param subimages: in a complete image
    :param per_datagram: subimages in a datagram
    :param datagram: size on the air [byte]
    :param degradation_preference: 1: maintain the frame rate, and send fewer subimages down to one datagram an image;
        0: maintain quality, and send fewer images down to least_rate; in between both give way, in these parts of the
        octaves
    :param least_rate: the rate falls below this only for images of one datagram [Hz]
    :return: max_subimages and rate, the cheapest first
    """
    datagrams = -(-subimages // per_datagram)
    least_rate = min(rate, least_rate)

    def point(scarcity: float) -> OperatingPoint:
        count = min(datagrams, max(1, int(datagrams / scarcity ** degradation_preference + TOLERANCE)))
        images = min(rate, max(least_rate, rate / scarcity * datagrams / count))
        count = min(count, max(1, int(datagrams * rate / scarcity / images + TOLERANCE)))
        complete = count == datagrams
        return OperatingPoint({'max_subimages': 0 if complete else count * per_datagram, 'rate': images},
                              images * count * datagram)

    return _ascending(point, rate * datagrams / least_rate)


FAIR_PREFERENCE = 0.75
"""degradation_preference from which on images lose only bytes as long as they are fair."""


def layered_points(rate: float, size: float, degradation_preference: float = 0.75, fair_size: float = 4000.0,
                   least_size: float = 1000.0, least_rate: float = 4.0) -> List[OperatingPoint]:
    """Operating points of layered images: fewer bytes an image, and fewer images.

    The last bytes of an image are hardly seen. So bytes give way first, and from a fair image on both.

    :param rate: of images, as requested or of the source [Hz]
    :param size: of a complete image on the air [byte]
    :param degradation_preference: as of image_points: 1: maintain the frame rate, and send fewer bytes down to
        least_size; 0: maintain quality, and send fewer images down to least_rate; in between both give way, in these
        parts of the octaves, and down to fair_size in parts of the octaves that are larger by 1 / FAIR_PREFERENCE
    :param fair_size: of a fair image on the air [byte]
    :param least_size: of an image [byte]
    :param least_rate: rates do not fall below it. Where fewer images are requested, they cost as much as this rate of
        them: an image leaves within its period at the stream's share of the link, and is no older [Hz]
    :return: rate, the cheapest first; the size of images follows what they may use of the link (Plan.rooms)
    """
    size, least_size = int(max(size, least_size)), int(least_size)
    slowest, fair = min(rate, least_rate), min(max(fair_size, least_size), size)
    preference = min(1.0, degradation_preference / FAIR_PREFERENCE)

    def point(scarcity: float) -> OperatingPoint:
        count = int(size / scarcity ** preference + TOLERANCE)
        if count < fair:
            scarcity_of_fair = (size / fair) ** (1 / preference)
            count = int(fair / (scarcity / scarcity_of_fair) ** degradation_preference + TOLERANCE)
        count = min(size, max(least_size, count))
        images = min(rate, max(slowest, rate / scarcity * size / count))
        count = min(count, max(least_size, int(size * rate / scarcity / images + TOLERANCE)))
        return OperatingPoint({'rate': images}, count * max(images, least_rate))

    return _ascending(point, rate / slowest * size / least_size)


def with_late(points: List[OperatingPoint], pace: float) -> List[OperatingPoint]:
    """Operating points of images, and cheaper ones before them: the cheapest images come late, down to LATE_RATE.

    :param points: the cheapest first, at least one
    :param pace: rate by which the cheapest one costs what it does [Hz]
    """
    settings, cost = points[0]
    steps = math.ceil(math.log(max(1.0, pace / LATE_RATE), STEP) - TOLERANCE)
    paces = [max(LATE_RATE, pace / STEP ** step) for step in range(steps, 0, -1)]
    return [OperatingPoint({**settings, 'rate': min(settings['rate'], late)}, cost * late / pace)
            for late in paces] + points


def cloud_points(rate: float, leaf_size: float, size: float, max_leaf_size: float = 1.0,
                 least_rate: float = 1.0) -> List[OperatingPoint]:
    """Operating points of clouds: larger voxels and fewer clouds alike; at least_rate larger voxels only.

    :param rate: [Hz]
    :param leaf_size: the finest, as requested [m]
    :param size: of a cloud at that leaf size [byte]
    :return: leaf_size and rate, the cheapest first
    """
    least_rate, max_leaf_size = min(rate, least_rate), max(leaf_size, max_leaf_size)

    def point(scarcity: float) -> OperatingPoint:
        # a LiDAR sees surfaces: the number of voxels is inversely proportional to their side's square
        reduction = max(scarcity ** 0.5, scarcity * least_rate / rate)
        leaf = min(max_leaf_size, leaf_size * reduction ** 0.5)
        reduction = (leaf / leaf_size) ** 2
        clouds = max(least_rate, rate * reduction / scarcity)
        return OperatingPoint({'leaf_size': round(leaf, 4), 'rate': clouds}, clouds * size / reduction)

    return _ascending(point, rate / least_rate * (max_leaf_size / leaf_size) ** 2)


def map_points(repeat_rate: float, segments: int, size: float, least_repeat: float = 0.02,
               least_segments: int = 8) -> List[OperatingPoint]:
    """Operating points of maps: fewer refresh cycles first, as these only repair losses; then larger blocks.

    :param repeat_rate: of refresh cycles, as requested [Hz]
    :param segments: that carry the complete map
    :param size: of a segment [byte]
    :return: repeat_rate and max_segments, the cheapest first
    """
    least_repeat, least_segments = min(repeat_rate, least_repeat), min(segments, least_segments)

    def point(scarcity: float) -> OperatingPoint:
        cycles = max(least_repeat, repeat_rate / scarcity)
        count = max(least_segments, int(segments * repeat_rate / scarcity / cycles + TOLERANCE))
        return OperatingPoint({'repeat_rate': cycles, 'max_segments': count}, cycles * count * size)

    return _ascending(point, repeat_rate / least_repeat * segments / least_segments)


def tile_points(max_bitrate: float, need: float, least_bitrate: float = 8.0) -> List[OperatingPoint]:
    """Operating points of maps in tiles: a lower pace. None costs more than what is needed.

    They are as many whatever is needed: a stream that needs more all at once has it at once, if the link allows.

    :param max_bitrate: as requested [kbit/s]
    :param need: what it would send [byte/s]
    :return: max_bitrate, the cheapest first
    """
    steps = math.ceil(math.log(max(1.0, max_bitrate / least_bitrate), STEP) - TOLERANCE)
    bitrates = [max(min(max_bitrate, least_bitrate), max_bitrate / STEP ** step) for step in range(steps, -1, -1)]
    return [OperatingPoint({'max_bitrate': bitrate}, min(bitrate * KBIT, need)) for bitrate in bitrates]


def rate_points(rate: float, size: float, least_rate: float = 1.0) -> List[OperatingPoint]:
    """Operating points of messages that cannot be made coarser: fewer of them.

    :param rate: [Hz]
    :param size: of a message [byte]
    :return: rate, the cheapest first
    """
    least_rate = min(rate, least_rate)

    def point(scarcity: float) -> OperatingPoint:
        messages = max(least_rate, rate / scarcity)
        return OperatingPoint({'rate': messages}, messages * size)

    return _ascending(point, rate / least_rate)


def _ascending(point: Callable[[float], OperatingPoint], max_scarcity: float) -> List[OperatingPoint]:
    """The points from max_scarcity to scarcity 1, without those that do not cost more than the one before."""
    points: List[OperatingPoint] = []
    for step in range(math.ceil(math.log(max_scarcity, STEP) - TOLERANCE), -1, -1):
        candidate = point(min(max_scarcity, STEP ** step))
        if not points or candidate.cost > points[-1].cost * (1 + TOLERANCE):
            points.append(candidate)
    return points
