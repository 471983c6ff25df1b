# SPDX-License-Identifier: BSD-3-Clause
"""Subimages of the interleave in frames, for images and maps alike (D6.3, section 4.1)."""
from typing import Any, List, Mapping, Tuple

from ..arrays import Array, Records
from ..udpros.frame import Frame


def subimage_frames(segment_class: Any, subimages: Array, per_segment: int,
                    lengths: Mapping[str, int]) -> List[Tuple[slice, Frame]]:
    """Empty frames for subimages: the full segments, and a shorter last one.

    :param subimages: (n, size) uint8
    :param per_segment: subimages in a full segment
    :param lengths: {dotted field: length} of the varying fields besides `data`
    :return: [(which subimages, frame), ...]
    """
    full = len(subimages) // per_segment * per_segment
    parts = [(slice(0, full), per_segment), (slice(full, len(subimages)), len(subimages) - full)]
    size = subimages.shape[1]
    return [(part, Frame(segment_class, (part.stop - part.start) // count, {**lengths, 'data': count * size}))
            for part, count in parts if part.stop > part.start]


def write_subimages(records: Records, cut: Any, part: slice, subimages: Array) -> None:
    """Write subimages and their place in the image into records, the same number into each.

    :param cut: interleave.Interleave
    :param part: which subimages, from `subimage_frames`
    :param subimages: (n, size) uint8
    """
    count = (part.stop - part.start) // len(records)
    records['depth'] = cut.depth
    records['index'], records['count'] = cut.order[part][::count], count
    records['data'] = subimages[part].reshape(len(records), -1)
