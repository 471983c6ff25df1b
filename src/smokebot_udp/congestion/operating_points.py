# SPDX-License-Identifier: BSD-3-Clause
"""What a stream can be turned down to, kind by kind: steps from the least of use up to all, with what each costs.

Four steps halve the bytes a second. What a share leaves over between two steps others get.
"""
import math
from typing import Any, Dict, List, NamedTuple

STEP = 2 ** 0.25


class Level(NamedTuple):
    """One step."""
    settings: Dict[str, Any]
    """As streams.yaml names them."""
    cost: float
    """What it takes of the link [byte/s]."""


def image_levels(rate, subimages, per_datagram, datagram, taste=0.75, least_rate=2.0):
    """Fewer subimages, and fewer pictures.

    :param rate: of pictures that are wanted, at most [Hz]
    :param subimages: a whole picture's
    :param per_datagram: subimages that a datagram holds
    :param datagram: [byte]
    :param taste: what gives way where the link is slow: 1: subimages only, down to one datagram a picture, before a
        picture is left out; 0: pictures only, down to least_rate; between, both, in such parts of the octaves
    :param least_rate: fewer pictures than this only where they are of one datagram [Hz]
    :return: [Level, ...] of max_subimages and rate, the cheapest first
    """
    datagrams = -(-subimages // per_datagram)
    least_rate = min(rate, least_rate)

    def level(scarcity):
        count = min(datagrams, max(1, int(datagrams / scarcity ** taste + 1e-9)))
        pictures = min(rate, max(least_rate, rate / scarcity * datagrams / count))
        count = min(count, max(1, int(datagrams * rate / scarcity / pictures + 1e-9)))
        whole = count == datagrams
        return Level({'max_subimages': 0 if whole else count * per_datagram, 'rate': pictures},
                     pictures * count * datagram)

    return _ascending(level, rate * datagrams / least_rate)


def cloud_levels(rate, leaf_size, size, most_leaf=1.0, least_rate=1.0):
    """Larger boxes and fewer clouds alike; where no fewer clouds may come, larger boxes alone.

    :param rate: [Hz]
    :param leaf_size: the finest that is wanted [m]
    :param size: of a cloud at that leaf size [byte]
    :return: [Level, ...] of leaf_size and rate, the cheapest first
    """
    least_rate = min(rate, least_rate)

    def level(scarcity):
        # what a LiDAR sees is surfaces: as many boxes as their side's square has room for
        thinned = max(scarcity ** 0.5, scarcity * least_rate / rate)
        leaf = min(max(leaf_size, most_leaf), leaf_size * thinned ** 0.5)
        thinner = (leaf / leaf_size) ** 2
        clouds = max(least_rate, rate * thinner / scarcity)
        return Level({'leaf_size': round(leaf, 4), 'rate': clouds}, clouds * size / thinner)

    return _ascending(level, rate / least_rate * (max(leaf_size, most_leaf) / leaf_size) ** 2)


def map_levels(repeat_rate, segments, size, least_repeat=0.02, least_segments=8):
    """Fewer rounds first, for they only repair what was lost; then larger blocks.

    :param repeat_rate: of rounds that are wanted, at most [Hz]
    :param segments: that carry the whole map
    :param size: of a segment [byte]
    :return: [Level, ...] of repeat_rate and max_segments, the cheapest first
    """
    least_repeat, least_segments = min(repeat_rate, least_repeat), min(segments, least_segments)

    def level(scarcity):
        rounds = max(least_repeat, repeat_rate / scarcity)
        count = max(least_segments, int(segments * repeat_rate / scarcity / rounds + 1e-9))
        return Level({'repeat_rate': rounds, 'max_segments': count}, rounds * count * size)

    return _ascending(level, repeat_rate / least_repeat * segments / least_segments)


def rate_levels(rate, size, least_rate=1.0):
    """Fewer messages, for what cannot be made coarser.

    :param rate: [Hz]
    :param size: of a message [byte]
    :return: [Level, ...] of rate, the cheapest first
    """
    least_rate = min(rate, least_rate)
    return _ascending(lambda scarcity: Level({'rate': max(least_rate, rate / scarcity)},
                                             max(least_rate, rate / scarcity) * size), rate / least_rate)


def _ascending(level, most) -> List[Level]:
    """The levels of all scarcities from `most` to 1, each that costs more than the one before."""
    levels: List[Level] = []
    for step in range(math.ceil(math.log(most, STEP) - 1e-9), -1, -1):
        made = level(min(most, STEP ** step))
        if not levels or made.cost > levels[-1].cost * (1 + 1e-9):
            levels.append(made)
    return levels
