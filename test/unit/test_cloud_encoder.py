# SPDX-License-Identifier: BSD-3-Clause
from typing import Any, Optional, Tuple

import numpy as np
import pytest
from genpy import Time
from sensor_msgs.msg import PointCloud2, PointField

from evaluation.linked_encoder import LinkedEncoder
from smokebot_udp.codecs.perception.voxel import voxel_filter
from smokebot_udp.mission.parameters import check
from smokebot_udp.mission.settings import Settings
from smokebot_udp.msg import CloudChunk
from smokebot_udp.simulation.lidar import POINT, Lidar
from smokebot_udp.simulation.world import building
from smokebot_udp.streams.air import Air
from smokebot_udp.streams.cloud.encoder import CloudEncoder
from smokebot_udp.streams.outlook import Outlook
from smokebot_udp.streams.segments import size_on_air
from smokebot_udp.udpros.datagram import OVERHEAD

pytestmark = pytest.mark.filterwarnings('error')
BOUND, LEAF, DATAGRAM = 0.0125, 0.1, 1472
FIELDS = [PointField(name, POINT.fields[name][1], PointField.FLOAT32, 1) for name in ('x', 'y', 'z', 'intensity')]


def cloud_message(points: Any, frame_id: str = 'velodyne') -> Any:
    """A PointCloud2 of an array of lidar.POINT."""
    message = PointCloud2(height=1, width=len(points), point_step=points.itemsize, row_step=points.nbytes,
                          data=points.tobytes(), fields=FIELDS)
    message.header.stamp, message.header.frame_id = Time(1700000000, 5), frame_id
    return message


@pytest.fixture(scope='module')
def scan() -> Any:
    points = Lidar(building(1), 0.9, 1).scan((1.5, 7, 0.3), 1.0)
    points['x'][::100] = np.nan
    return points


def settings(granted: Optional[dict] = None, **options: Any) -> Settings:
    return Settings(check({'robot_topic': '/points', **options}, CloudEncoder.PARAMETERS), granted or {})


def frame_of(message: Any, size: int = DATAGRAM, **options: Any) -> Any:
    of = settings(**options)
    frame, = LinkedEncoder(CloudEncoder(of.requested)).encode(message, of, size)
    assert frame.datagram_size <= size
    return frame


def thinned(scan: Any, intensity: bool = False, leaf: float = LEAF) -> Tuple[Any, Any]:
    kept = scan[np.isfinite(scan['x'])]
    points = np.stack([kept[name] for name in 'xyz'], axis=1)
    values = kept['intensity'].copy() if intensity else None
    return voxel_filter(points, leaf, values) if leaf else (points, values)


@pytest.mark.parametrize('encoding', ['float32', 'packed'])
@pytest.mark.parametrize('intensity', [False, True])
def test_a_datagram_reads_as_the_message_says(scan: Any, encoding: str, intensity: bool) -> None:
    """Read in Python alone, word for word from CloudChunk.msg."""
    frame = frame_of(cloud_message(scan), encoding=encoding, intensity=intensity)
    expected, expected_values = thinned(scan, intensity)
    for row in frame.rows[:5]:
        chunk = CloudChunk().deserialize(row[OVERHEAD:].tobytes())
        assert (chunk.header.frame_id, chunk.points, chunk.chunks) == ('velodyne', len(expected), len(frame))
        assert chunk.has_intensity == intensity and (chunk.step > 0) == (encoding == 'packed')
        width = sum(chunk.bits) + 8 * intensity
        size = -(-width // 8) if chunk.step else 16 if intensity else 12
        assert len(chunk.data) == size * -(-chunk.points // chunk.chunks)
        number = chunk.index
        for at in range(0, len(chunk.data), size):
            data = chunk.data[at:at + size]
            if chunk.step:
                whole, point = int.from_bytes(data, 'little'), []
                for origin, bits in zip(chunk.origin, chunk.bits):
                    point.append((origin + whole % (1 << bits)) * chunk.step)
                    whole >>= bits
                if intensity:
                    point.append(chunk.intensity_min + chunk.intensity_step * whole)
            else:
                point = np.frombuffer(data, '<f4')
            place = min(number, chunk.points - 1)
            assert point[:3] == pytest.approx(expected[place], abs=(BOUND if chunk.step else 0) + 2e-6)
            if intensity:
                assert point[3] == pytest.approx(expected_values[place], abs=chunk.intensity_step / 2 + 1e-4)
            number += chunk.chunks


@pytest.mark.parametrize('size', [200, 576, DATAGRAM, 8000])
@pytest.mark.parametrize('encoding', ['float32', 'packed'])
@pytest.mark.parametrize('frame_id', ['', 'robot/velodyne/a_long_name'])
def test_datagrams_are_full_and_no_longer_than_they_may_be(scan: Any, size: int, encoding: str, frame_id: str) -> None:
    frame = frame_of(cloud_message(scan, frame_id), size, encoding=encoding, intensity=True, points_per_chunk=5000)
    points, data = int(frame.records['points'][0]), frame.records['data'].shape[1]
    a_point = data // -(-points // len(frame))
    most = (size - frame.datagram_size + data) // a_point
    assert frame.datagram_size <= size and len(frame) == -(-points // most)


def test_packed_takes_less_than_half(scan: Any) -> None:
    for leaf in (0.0, LEAF):
        exact, short = (frame_of(cloud_message(scan), encoding=encoding, leaf_size=leaf)
                        for encoding in ('float32', 'packed'))
        assert short.rows.nbytes <= exact.rows.nbytes / 2
        count = int(short.records['points'][0])
        assert count == exact.records['points'][0] and -(-count // len(short)) >= 200
        assert len(exact) == -(-count // 80)


@pytest.mark.parametrize('size', [250, 576, DATAGRAM, 8000])
@pytest.mark.parametrize('intensity', [False, True])
def test_sorted_takes_less_than_packed_in_datagrams_that_fit(scan: Any, size: int, intensity: bool) -> None:
    packed, ordered = (frame_of(cloud_message(scan, 'velodyne'), size, encoding=encoding, intensity=intensity)
                       for encoding in ('packed', 'sorted'))
    assert ordered.datagram_size <= size and ordered.records['points'][0] == packed.records['points'][0]
    assert len(packed.records['codes'][0]) == 0 < len(ordered.records['codes'][0])
    assert ordered.rows.nbytes < (0.55 if size >= DATAGRAM and not intensity else 0.95) * packed.rows.nbytes
    for field in ('step', 'origin', 'bits', 'has_intensity', 'intensity_min', 'intensity_step'):
        assert packed.records[field][0].tolist() == ordered.records[field][0].tolist()


@pytest.mark.parametrize('x, step', [
    ([0, 1], 0.025),                    # the codes would take more than they save
    ([0, 30000], 0.0),                  # too far apart for offsets
    ([0] * 700 + [25000], 0.025)])      # sorted
def test_what_sorting_does_not_shorten_is_sent_as_packed(x: Any, step: float) -> None:
    points = np.zeros(len(x), POINT)
    points['x'] = x
    records = frame_of(cloud_message(points), encoding='sorted', leaf_size=0.0).records
    assert records['step'][0] == np.float32(step) and bool(len(records['codes'][0])) == (len(x) > 2)


@pytest.mark.parametrize('losses, known, least', [
    ({0.0: 1.0}, True, 8), ({0.5: 1.0}, True, 8), ({0.8: 1.0}, True, 11), ({0.5: 0.8, 0.9: 0.2}, True, 8),
    ({0.5: 0.6, 0.9: 0.4}, True, 22), ({0.99: 1.0}, True, 32), ({1.0: 1.0}, True, 32), ({0.9: 1.0}, False, 8)])
def test_the_more_is_lost_the_more_datagrams_there_are(scan: Any, losses: Any, known: bool, least: int) -> None:
    of = settings(encoding='sorted')
    encoder = LinkedEncoder(CloudEncoder(of.requested))
    encoder.see(outlook=Outlook(Air(losses, None, known)))
    frame, = encoder.encode(cloud_message(scan), of, DATAGRAM)
    assert len(frame) == least


def test_a_cloud_in_too_many_chunks_is_refused() -> None:
    points = np.zeros(65536, POINT)
    with pytest.raises(ValueError, match='65536 points in 65536 chunks'):
        frame_of(cloud_message(points), leaf_size=0.0, points_per_chunk=1)
    assert len(frame_of(cloud_message(points[1:]), leaf_size=0.0, points_per_chunk=1)) == 65535


@pytest.mark.parametrize('encoding', ['float32', 'packed', 'sorted'])
def test_a_cloud_in_which_nothing_was_seen_is_sent(encoding: str) -> None:
    points = np.zeros(3, POINT)
    points['x'] = np.nan
    bare = PointCloud2(height=1, width=0)
    for message in (cloud_message(points), cloud_message(points[:0]), bare):
        of = settings(encoding=encoding, intensity=True, fields='ring')
        encoder = LinkedEncoder(CloudEncoder(of.requested))
        frame, = encoder.encode(message, of, DATAGRAM)
        assert len(frame) == 1 and frame.records['points'].tolist() == [0] and frame.records['data'].size == 0
        assert not encoder.warnings or message.width


def test_nothing_seen_says_nothing_of_what_clouds_take(scan: Any) -> None:
    of = settings()
    encoder = LinkedEncoder(CloudEncoder(of.requested))
    encoder.encode(cloud_message(scan), of, DATAGRAM)
    size = encoder.message_size
    encoder.encode(cloud_message(scan[:0]), of, DATAGRAM)
    assert encoder.message_size == size


@pytest.mark.parametrize('change', [{'row_step': 0}, {'row_step': 4000 * POINT.itemsize}])
def test_a_row_step_that_contradicts_the_data_is_told_once(scan: Any, change: dict) -> None:
    of = settings()
    encoder, message = LinkedEncoder(CloudEncoder(of.requested)), cloud_message(scan[:4000])
    wanted, = encoder.encode(message, of, DATAGRAM)
    message.height, message.width = 40, 100
    encoder.warnings.clear()
    for name, value in change.items():
        setattr(message, name, value)
    frame, = encoder.encode(message, of, DATAGRAM)
    assert frame.rows.tobytes() == wanted.rows.tobytes()
    assert list(encoder.warnings) == ['row_step is %d, by the data it is %d' % (change['row_step'],
                                                                                 100 * POINT.itemsize)]


def test_a_side_of_the_crop_box_at_its_limit_crops_nothing() -> None:
    points = np.zeros(2, POINT)
    points['x'], points['z'] = (5e6, -5e6), (1, -1)
    assert frame_of(cloud_message(points), min_z=0.0).records['points'][0] == 1


def test_a_crop_box_that_is_turned_round_is_refused() -> None:
    with pytest.raises(ValueError, match='min_y is 2, above max_y, 1'):
        CloudEncoder(settings(min_y=2.0, max_y=1.0).requested)


def test_the_granted_leaf_size_counts_and_the_requested_one_is_the_best(scan: Any) -> None:
    of = settings({'leaf_size': 0.4})
    encoder = LinkedEncoder(CloudEncoder(of.requested))
    assert encoder.operating_points(10.0, of) == []
    frame, = encoder.encode(cloud_message(scan), of, DATAGRAM)
    assert frame.records['points'][0] == len(thinned(scan, leaf=0.4)[0])
    points = encoder.operating_points(10.0, of)
    assert points[-1].settings == {'leaf_size': 0.1, 'rate': 10.0}
    # by the surfaces' law, 16 times the points
    assert points[-1].cost == pytest.approx(10.0 * 16 * size_on_air([frame]))
    assert points[0].settings['leaf_size'] > 0.1


def test_a_cloud_that_is_not_filtered_comes_more_rarely(scan: Any) -> None:
    of = settings(leaf_size=0.0)
    encoder = LinkedEncoder(CloudEncoder(of.requested))
    frames = encoder.encode(cloud_message(scan), of, DATAGRAM)
    points = encoder.operating_points(10.0, of)
    assert points[0].settings == {'rate': 1.0} and points[-1].cost == pytest.approx(10.0 * size_on_air(frames))
