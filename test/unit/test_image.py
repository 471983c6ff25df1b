# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest

from smokebot_udp.codecs.concealment.fill import nearest
from smokebot_udp.codecs.concealment.kriging import kriging
from smokebot_udp.codecs.wire.interleave import fit
from smokebot_udp.codecs.wire.partial_image import Picture, mask_of
from smokebot_udp.codecs.wire.pixels import item_type, pixel_type

HEIGHT, WIDTH = 45, 60


def segments_of(encoding='mono16', room=300, seed=0):
    """A picture's items, and its segments: [(index, count, payload), ...]."""
    item = item_type(encoding)
    items = np.frombuffer(np.random.RandomState(seed).bytes(HEIGHT * WIDTH * item.itemsize), item)
    items = items.reshape(HEIGHT, WIDTH)
    cut, per_segment = fit(HEIGHT, WIDTH, item.itemsize, room)
    rows = np.ascontiguousarray(cut.split(items)).reshape(len(cut), -1).view(np.uint8)
    segments = [(cut.order[i], len(rows[i:i + per_segment]), rows[i:i + per_segment].ravel())
                for i in range(0, len(rows), per_segment)]
    return items, cut, segments


def take(picture, *segments):
    """Add segments one by one; which were taken."""
    return [bool(picture.add(np.array([index]), np.array([count]), payload[np.newaxis])[0])
            for index, count, payload in segments]


def empty(cut, encoding='mono16', total=None):
    return Picture(HEIGHT, WIDTH, cut.depth, item_type(encoding), len(cut) if total is None else total)


@pytest.mark.parametrize('encoding', ['mono8', 'mono16', 'bgr8', 'rgba8', '32FC1'])
def test_all_segments_in_any_order_make_the_exact_picture(encoding):
    items, cut, segments = segments_of(encoding)
    picture = empty(cut, encoding)
    order = np.random.RandomState(1).permutation(len(segments))
    assert all(take(picture, *(segments[i] for i in order)))
    assert picture.complete and picture.completeness == 1
    assert picture.items(nearest).tobytes() == items.tobytes()


def test_a_batch_is_taken_at_once():
    items, cut, segments = segments_of()
    picture = empty(cut)
    same = [segment for segment in segments if segment[1] == segments[0][1]]
    indexes, counts, payloads = (np.array(column) for column in zip(*same))
    assert picture.add(indexes, counts, payloads).all()
    assert picture.have.sum() == counts.sum()


def test_missing_segments_are_filled_and_received_pixels_exact():
    items, cut, segments = segments_of()
    picture = empty(cut)
    take(picture, *segments[::2])
    assert 0.4 < picture.completeness < 0.6 and not picture.complete
    came = cut.merge(np.repeat(picture.have, cut.shape[0] * cut.shape[1]).reshape((-1,) + cut.shape))
    assert 0.4 < came.mean() < 0.6
    assert (picture.items(nearest)[came] == items[came]).all()


@pytest.mark.parametrize('encoding', ['mono16', 'bgr8', '32FC1'])
@pytest.mark.parametrize('is_bigendian', [False, True])
def test_a_fill_that_reckons_gets_the_numbers_of_the_pixels(encoding, is_bigendian):
    items, cut, segments = segments_of(encoding)
    picture = empty(cut, encoding)
    take(picture, *segments[::2])
    channel, channels = pixel_type(encoding, is_bigendian)
    seen = []
    filled = picture.items(lambda *arguments: seen.append(arguments) or kriging(*arguments), channel)
    subimages, have, _ = seen[0]
    numbers = items.view(channel).reshape(HEIGHT, WIDTH, channels)
    assert subimages.dtype == channel
    assert subimages[have].tobytes() == cut.split(numbers)[have].tobytes()
    assert filled.dtype == items.dtype
    expected = cut.merge(kriging(subimages, have, cut))
    assert filled.tobytes() == expected.tobytes()


def test_duplicates_are_counted_and_change_nothing():
    items, cut, segments = segments_of()
    picture = empty(cut)
    take(picture, *segments, *segments[:3])
    assert picture.duplicates == 3 * segments[0][1]
    assert picture.items(nearest).tobytes() == items.tobytes()


def test_duplicates_in_one_batch_are_counted():
    _, cut, segments = segments_of()
    indexes, counts, payloads = (np.array(column) for column in zip(*segments[:3], segments[1], segments[1]))
    picture = empty(cut)
    assert picture.add(indexes, counts, payloads).all()
    assert picture.duplicates == 2 * segments[1][1]


def test_a_prefix_is_complete_when_all_that_was_sent_came():
    items, cut, segments = segments_of()
    count = segments[0][1]
    picture = empty(cut, total=3 * count)
    assert take(picture, *segments[:2]) == [True] * 2 and not picture.complete
    assert take(picture, segments[3]) == [False]     # beyond what is sent
    assert take(picture, segments[2]) == [True] and picture.complete


def test_the_end_is_noticed():
    _, cut, segments = segments_of()
    picture = empty(cut)
    take(picture, *segments[:-5])
    assert not picture.ending
    take(picture, segments[-2])
    assert picture.ending


@pytest.mark.parametrize('change', [
    lambda i, c, p: (i + 60000, c, p),             # no such subimage
    lambda i, c, p: (i, c + 1, p),                 # says to hold more than it does
    lambda i, c, p: (i, 0, p),
    lambda i, c, p: (i, c, p[:-1]),
    lambda i, c, p: (i, c, np.append(p, 0)),
    lambda i, c, p: (i, c, p[:0])])
def test_segments_that_contradict_the_picture_are_dropped(change):
    _, cut, segments = segments_of()
    picture = empty(cut)
    assert take(picture, change(*segments[0])) == [False]
    assert not picture.have.any()


def test_one_bad_segment_does_not_cost_its_batch():
    _, cut, segments = segments_of()
    indexes, counts, payloads = (np.array(column) for column in zip(*segments[:4]))
    indexes[2] = 65535
    assert empty(cut).add(indexes, counts, payloads).tolist() == [True, True, False, True]


@pytest.mark.parametrize('height, width, depth, total, message', [
    (0, 9, 1, 1, 'height is 0'), (9, 5000, 1, 1, 'width is 5000'), (9, 9, 9, 1, 'depth is 9'),
    (9, 9, 1, 5, 'total is 5'), (9, 9, 1, 0, 'total is 0')])
def test_impossible_pictures(height, width, depth, total, message):
    with pytest.raises(ValueError, match=message):
        Picture(height, width, depth, np.dtype('u1'), total)


def test_memory_is_bounded():
    """129 rows at depth 7 are padded to 256: what is allocated counts, not what is declared."""
    with pytest.raises(ValueError, match='too many'):
        Picture(4095, 4095, 0, np.dtype('V8'), 1)
    assert Picture(4096, 4096, 8, np.dtype('u4'), 1).have.sum() == 0


def test_a_mask_tells_received_remembered_and_filled_pixels():
    came, known = np.array([[True, False, False]]), np.array([[True, True, False]])
    mask = mask_of(came, known)
    assert mask.dtype == np.uint8 and mask.tolist() == [[255, 128, 0]]
