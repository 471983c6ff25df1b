# SPDX-License-Identifier: BSD-3-Clause
"""Splitting and merging of one message of each kind: medians on one core, without ROS in between.

For comparison: rospy's serialisation and a JPEG of the same image, the alternatives of a user.
"""
import copy
import functools
import io
import statistics
import time
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Optional

import cv2
import numpy as np
import skimage.data
from nav_msgs.msg import OccupancyGrid
from sensor_msgs.msg import Image, LaserScan, PointCloud2, PointField

from evaluation.offline_link import Receiver, Sender
from evaluation.pcl_plane import fit_by_pcl
from smokebot_udp import optional
from smokebot_udp.codecs.layered import image as layered
from smokebot_udp.codecs.perception import ground, voxel
from smokebot_udp.codecs.wire import pixels, scan
from smokebot_udp.codecs.wire.points import as_points
from smokebot_udp.simulation.lidar import POINT, Lidar
from smokebot_udp.simulation.world import building
from smokebot_udp.streams.virtual_scan.fans import FanCache

ROUNDS, QUICK_ROUNDS = 40, 10


class Case(NamedTuple):
    """What is measured."""
    function: Callable[[], Any]
    goal: Optional[float] = None
    """[ms]"""


def cloud_message() -> Any:
    """A PointCloud2 of 23 040 points."""
    points = Lidar(building(1), 0.9, 1).scan((1.5, 7.0, 0.3), 0.0)
    layout: Any = POINT.fields
    fields = [PointField(name, layout[name][1], PointField.FLOAT32, 1) for name in ('x', 'y', 'z', 'intensity')]
    message = PointCloud2(height=1, width=len(points), fields=fields, point_step=points.itemsize,
                          row_step=points.nbytes, data=points.tobytes())
    message.header.frame_id = 'velodyne'
    return message


def map_message(side: int) -> Any:
    """A square OccupancyGrid of random cells."""
    cells = np.random.RandomState(1).choice(np.array([-1, 0, 100], np.int8), side * side)
    message = OccupancyGrid(data=cells)
    message.info.width, message.info.height, message.info.resolution = side, side, 0.05
    return message


def image_message(encoding: str) -> Any:
    """An Image of 640 x 480 random pixels."""
    size = pixels.item_type(encoding).itemsize
    return Image(height=480, width=640, encoding=encoding, step=640 * size,
                 data=np.random.RandomState(2).bytes(480 * 640 * size))


def scan_message() -> Any:
    """A LaserScan of 720 random ranges."""
    return LaserScan(ranges=scan.in_millimetres(np.random.RandomState(3).randint(50, 30000, 720)), angle_min=-np.pi,
                     angle_increment=np.pi / 360, range_max=30.0)


def perception_cases(cloud: Any) -> Dict[str, Case]:
    """What is implemented several times, because neither python3-pcl nor numba is available everywhere."""
    xyz, intensity = as_points(cloud, with_intensity=True)
    random = np.random.RandomState(4)
    candidates = ground.GroundFinder(0.9).candidates(xyz)
    voters = candidates[random.permutation(len(candidates))[:ground.VOTERS]]
    result = {}
    for library, voxels, fit in (('pcl', voxel.filter_by_pcl, fit_by_pcl),
                                 ('numba', voxel.filter_by_loops, ground.fit_by_loops),
                                 ('numpy', voxel.filter_by_numpy, ground.fit_by_numpy)):
        if optional.attempt(library).module is not None:
            result['  voxels only, by ' + library] = Case(functools.partial(voxels, xyz, 0.1))
            result['  with intensity, by ' + library] = Case(functools.partial(voxels, xyz, 0.1, intensity))
            result['  ground plane only, by ' + library] = Case(functools.partial(fit, voters, 0.04, random))
    return result


def layered_cases() -> Dict[str, Case]:
    """Layered images of 640 x 480: photographs, and counts like a thermal camera's, at 80 kB and lossless."""
    random = np.random.RandomState(5)
    colour = cv2.resize(cv2.cvtColor(skimage.data.astronaut(), cv2.COLOR_RGB2BGR), (640, 480))
    grey = cv2.resize(skimage.data.camera(), (640, 480))
    counts = (13000 + 12.0 * grey + random.normal(0, 4, grey.shape)).astype(np.uint16)
    result = {}
    for name, shown, goal in (('mono8', grey, 15.0), ('mono16', counts, 15.0), ('bgr8', colour, 30.0)):
        channels = 1 if shown.ndim == 2 else 3
        for kind, lossless, budget in (('80 kB', False, 80000), ('lossless', True, 1 << 30)):
            limit = None if lossless and channels == 3 else 30.0 if lossless else goal
            data = layered.encode(shown, lossless, budget).data
            title = 'layered image of 640 x 480 %s, %s: ' % (name, kind)
            result[title + 'encode'] = Case(functools.partial(layered.encode, shown, lossless, budget), limit)
            result[title + 'decode'] = Case(functools.partial(layered.decode, data, 480, 640, channels,
                                                              shown.itemsize), limit)
    return result


def cases() -> Dict[str, Case]:
    """The cases by their names in the table."""
    plain, packed, ordered = (Sender('cloud', encoding=encoding) for encoding in ('float32', 'packed', 'sorted'))
    image_sender, image_receiver = Sender('image', coding='interleaved'), Receiver('image')
    cloud_receiver, map_sender, scan_sender = Receiver('cloud'), Sender('grid', coding='interleaved'), Sender('scan')
    fans = FanCache()       # both scans of a cloud share its points and its ground
    virtual_senders = [Sender('virtual_scan', fans, select=select, base_frame='')
                       for select in ('obstacle', 'landmark')]
    points, large, ranges = cloud_message(), map_message(2000), scan_message()
    thermal, colour = image_message('mono16'), image_message('bgr8')
    batches = [frame.records.copy() for frame in image_sender.frames(thermal)]
    halves = [records[::2] for records in batches]
    chunks, ordered_chunks = ([frame.records for frame in sender.frames(points)] for sender in (packed, ordered))
    grey = pixels.as_pixels(thermal.data, 480, 640, 1280, 'mono16', False)

    def both_scans() -> None:
        message = copy.copy(points)     # another message each time: both scans share what they compute of one
        for sender in virtual_senders:
            sender.frames(message)

    def changed_map() -> None:
        large.data[0] ^= 1     # an unchanged one is not split again
        map_sender.frames(large)

    return {
        'cloud of 23 040: voxels and chunks, float32': Case(lambda: plain.frames(points), 4.0),
        'cloud of 23 040: voxels and chunks, packed': Case(lambda: packed.frames(points), 4.0),
        'cloud of 23 040: voxels and chunks, sorted': Case(lambda: ordered.frames(points), 6.0),
        **perception_cases(points),
        'cloud: merge, packed': Case(lambda: cloud_receiver.assemble(chunks)),
        'cloud: merge, sorted': Case(lambda: cloud_receiver.assemble(ordered_chunks), 6.0),
        'cloud of 23 040: both virtual scans': Case(both_scans, 10.0),
        'map of 2000 x 2000: reduce and split': Case(changed_map, 20.0),
        'scan of 720: split': Case(lambda: scan_sender.frames(ranges)),
        'image of 640 x 480 mono16: split': Case(lambda: image_sender.frames(thermal)),
        'image of 640 x 480 bgr8: split': Case(lambda: image_sender.frames(colour)),
        'image of 640 x 480 mono16: merge': Case(lambda: image_receiver.assemble(batches)),
        '  the same, half of it filled': Case(lambda: image_receiver.assemble(halves)),
        **layered_cases(),
        'beside: rospy serialises that image': Case(lambda: thermal.serialize(io.BytesIO())),
        'beside: JPEG of its upper 8 bits': Case(lambda: cv2.imencode('.jpg', (grey >> 8).astype(np.uint8))),
    }


def measure(work: Mapping[str, Case], rounds: int, log: Callable[[str], None]) -> Dict[str, Dict[str, Optional[float]]]:
    """{case: {'median': [s], 'worst': [s], 'limit': the goal [s] or None}}; the cases take turns."""
    times: Dict[str, List[float]] = {name: [] for name in work}
    for number in range(rounds + 1):
        if number % 10 == 0:
            log('round %d of %d' % (number, rounds))
        for name, case in work.items():
            begun = time.perf_counter()
            case.function()
            times[name].append(time.perf_counter() - begun)
    return {name: {'median': statistics.median(times[name][1:]), 'worst': max(times[name][1:]),
                   'limit': case.goal and case.goal / 1e3} for name, case in work.items()}


def run(log: Callable[[str], None], quick: bool = False) -> Dict[str, Dict[str, Optional[float]]]:
    """As `measure`."""
    return measure(cases(), QUICK_ROUNDS if quick else ROUNDS, log)


def table(results: Dict[str, Dict[str, Any]], title: str = 'one message, without ROS in between') -> str:
    """The results as text."""
    lines = [title, '%-56s %12s %12s %12s' % ('', 'median [ms]', 'worst [ms]', 'goal [ms]')]
    for name, result in results.items():
        goal = '-' if result['limit'] is None else '%g' % (1e3 * result['limit'])
        lines.append('%-56s %12.2f %12.2f %12s' % (name, 1e3 * result['median'], 1e3 * result['worst'], goal))
    return '\n'.join(lines)
