# SPDX-License-Identifier: BSD-3-Clause
from typing import List, Optional, Tuple

import numpy as np
import pytest

from smokebot_udp.arrays import Array, UInt8Array
from smokebot_udp.codecs.concealment.fill import nearest
from smokebot_udp.codecs.concealment.kriging import kriging_clamped
from smokebot_udp.codecs.wire.interleave import Interleave, fit
from smokebot_udp.codecs.wire.partial_image import PartialImage, mask_of
from smokebot_udp.codecs.wire.pixels import item_type, pixel_type

HEIGHT, WIDTH = 45, 60
Segment = Tuple[int, int, UInt8Array]
"""(index, count, payload)"""


def segments_of(encoding: str = 'mono16', room: int = 300, seed: int = 0) -> Tuple[Array, Interleave, List[Segment]]:
    """An image's items, and its segments: [(index, count, payload), ...]."""
    item = item_type(encoding)
    items = np.frombuffer(np.random.RandomState(seed).bytes(HEIGHT * WIDTH * item.itemsize), item)
    items = items.reshape(HEIGHT, WIDTH)
    cut, per_segment = fit(HEIGHT, WIDTH, item.itemsize, room)
    rows = np.ascontiguousarray(cut.split(items)).reshape(len(cut), -1).view(np.uint8)
    segments = [(cut.order[i], len(rows[i:i + per_segment]), rows[i:i + per_segment].ravel())
                for i in range(0, len(rows), per_segment)]
    return items, cut, segments


def take(image: PartialImage, *segments: Segment) -> List[bool]:
    """Add segments one by one; which were taken."""
    return [bool(image.add(np.array([index]), np.array([count]), payload[np.newaxis])[0])
            for index, count, payload in segments]


def empty(cut: Interleave, encoding: str = 'mono16', total: Optional[int] = None) -> PartialImage:
    return PartialImage(HEIGHT, WIDTH, cut.depth, item_type(encoding), len(cut) if total is None else total)


@pytest.mark.parametrize('encoding', ['mono8', 'mono16', 'bgr8', 'rgba8', '32FC1'])
def test_all_segments_in_any_order_make_the_exact_image(encoding) -> None:
    items, cut, segments = segments_of(encoding)
    image = empty(cut, encoding)
    order = np.random.RandomState(1).permutation(len(segments))
    assert all(take(image, *(segments[i] for i in order)))
    assert image.complete and image.completeness == 1
    assert image.items(nearest).tobytes() == items.tobytes()


def test_a_batch_is_taken_at_once() -> None:
    items, cut, segments = segments_of()
    image = empty(cut)
    same = [segment for segment in segments if segment[1] == segments[0][1]]
    indexes, counts, payloads = (np.array(column) for column in zip(*same))
    assert image.add(indexes, counts, payloads).all()
    assert image.have.sum() == counts.sum()


def test_missing_segments_are_filled_and_received_pixels_exact() -> None:
    items, cut, segments = segments_of()
    image = empty(cut)
    take(image, *segments[::2])
    assert 0.4 < image.completeness < 0.6 and not image.complete
    came = cut.merge(np.repeat(image.have, cut.shape[0] * cut.shape[1]).reshape((-1,) + cut.shape))
    assert 0.4 < came.mean() < 0.6
    assert (image.items(nearest)[came] == items[came]).all()


@pytest.mark.parametrize('encoding', ['mono16', 'bgr8', '32FC1'])
@pytest.mark.parametrize('is_bigendian', [False, True])
def test_a_fill_that_reckons_gets_the_numbers_of_the_pixels(encoding, is_bigendian) -> None:
    items, cut, segments = segments_of(encoding)
    image = empty(cut, encoding)
    take(image, *segments[::2])
    channel, channels = pixel_type(encoding, is_bigendian)
    seen = []
    filled = image.items(lambda *arguments: seen.append(arguments) or kriging_clamped(*arguments), channel)
    subimages, have, _ = seen[0]
    numbers = items.view(channel).reshape(HEIGHT, WIDTH, channels)
    assert subimages.dtype == channel
    assert subimages[have].tobytes() == cut.split(numbers)[have].tobytes()
    assert filled.dtype == items.dtype
    expected = cut.merge(kriging_clamped(subimages, have, cut))
    assert filled.tobytes() == expected.tobytes()


def test_duplicates_change_nothing() -> None:
    items, cut, segments = segments_of()
    image = empty(cut)
    take(image, *segments, *segments[:3])
    assert image.items(nearest).tobytes() == items.tobytes()


def test_duplicates_in_one_batch_fit() -> None:
    items, cut, segments = segments_of()
    indexes, counts, payloads = (np.array(column) for column in zip(*segments[:3], segments[1], segments[1]))
    image = empty(cut)
    assert image.add(indexes, counts, payloads).all()
    assert np.count_nonzero(image.have) == 3 * segments[1][1]


def test_the_mask_of_received_pixels_follows_what_is_added() -> None:
    _, cut, segments = segments_of()
    image = empty(cut)
    assert not image.received.any()
    for segment in segments[:3]:
        take(image, segment)
        assert (image.received == cut.pixel_mask(image.have)).all() and image.received.any()
        assert image.received is image.received
    take(image, *segments)
    assert image.received.all()


def test_a_prefix_is_complete_when_all_that_was_sent_is_received() -> None:
    items, cut, segments = segments_of()
    count = segments[0][1]
    image = empty(cut, total=3 * count)
    assert take(image, *segments[:2]) == [True] * 2 and not image.complete
    assert take(image, segments[3]) == [False]     # beyond what is sent
    assert take(image, segments[2]) == [True] and image.complete


def test_the_missing_segment_that_is_sent_last_is_awaited() -> None:
    _, cut, segments = segments_of()
    image, count = empty(cut), len(segments)
    take(image, *segments[:-5])
    assert image.awaited == count - 1
    take(image, *segments[-2:])
    assert image.awaited == count - 3
    indexes = np.array([index for index, _, _ in segments] + [60000])
    assert image.places(indexes).tolist() == [*range(count), -1]


@pytest.mark.parametrize('change', [
    lambda i, c, p: (i + 60000, c, p),             # no such subimage
    lambda i, c, p: (i, c + 1, p),                 # says to hold more than it does
    lambda i, c, p: (i, 0, p),
    lambda i, c, p: (i, c, p[:-1]),
    lambda i, c, p: (i, c, np.append(p, 0)),
    lambda i, c, p: (i, c, p[:0])])
def test_segments_that_contradict_the_image_are_dropped(change) -> None:
    _, cut, segments = segments_of()
    image = empty(cut)
    assert take(image, change(*segments[0])) == [False]
    assert not image.have.any()


def test_one_bad_segment_does_not_cost_its_batch() -> None:
    _, cut, segments = segments_of()
    indexes, counts, payloads = (np.array(column) for column in zip(*segments[:4]))
    indexes[2] = 65535
    assert empty(cut).add(indexes, counts, payloads).tolist() == [True, True, False, True]


@pytest.mark.parametrize('height, width, depth, total, message', [
    (0, 9, 1, 1, 'height is 0'), (9, 5000, 1, 1, 'width is 5000'), (9, 9, 9, 1, 'depth is 9'),
    (9, 9, 1, 5, 'total is 5'), (9, 9, 1, 0, 'total is 0')])
def test_impossible_images(height, width, depth, total, message) -> None:
    with pytest.raises(ValueError, match=message):
        PartialImage(height, width, depth, np.dtype('u1'), total)


def test_memory_is_bounded() -> None:
    """129 rows at depth 7 are padded to 256: what is allocated counts, not what is declared."""
    with pytest.raises(ValueError, match='too many'):
        PartialImage(4095, 4095, 0, np.dtype('V8'), 1)
    assert PartialImage(4096, 4096, 8, np.dtype('u4'), 1).have.sum() == 0


def test_a_mask_distinguishes_received_remembered_and_filled_pixels() -> None:
    came, known = np.array([[True, False, False]]), np.array([[True, True, False]])
    mask = mask_of(came, known)
    assert mask.dtype == np.uint8 and mask.tolist() == [[255, 128, 0]]
