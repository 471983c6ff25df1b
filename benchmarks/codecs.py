# SPDX-License-Identifier: BSD-3-Clause
"""Splitting and merging of one message of each kind: medians on one core, without ROS in between.

Beside them stand rospy's serialisation and a JPEG of the same picture, which are what a user would do instead.
"""
import io
import statistics
import time
from types import SimpleNamespace
from unittest import mock

import cv2
import numpy as np
from nav_msgs.msg import OccupancyGrid
from sensor_msgs.msg import Image, LaserScan, PointCloud2, PointField

from smokebot_udp.codecs.perception import voxel
from smokebot_udp.codecs.wire import pixels, scan
from smokebot_udp.simulation.lidar import POINT, Lidar
from smokebot_udp.simulation.world import building
from smokebot_udp.streams import operator_class, robot_class
from smokebot_udp.streams.base import Link
from smokebot_udp.streams.config import parameters_of
from smokebot_udp.streams.scan import scan_frames
from smokebot_udp.streams.segments import head_of

ROUNDS, QUICK_ROUNDS = 40, 10


def a_cloud():
    points = Lidar(building(1), 0.9, 1).scan((1.5, 7.0, 0.3), 0.0)
    fields = [PointField(name, POINT.fields[name][1], PointField.FLOAT32, 1) for name in ('x', 'y', 'z', 'intensity')]
    message = PointCloud2(height=1, width=len(points), fields=fields, point_step=points.itemsize,
                          row_step=points.nbytes, data=points.tobytes())
    message.header.frame_id = 'velodyne'
    return message


def a_map(side):
    cells = np.random.RandomState(1).choice(np.array([-1, 0, 100], np.int8), side * side)
    message = OccupancyGrid(data=cells)
    message.info.width, message.info.height, message.info.resolution = side, side, 0.05
    return message


def an_image(encoding):
    size = pixels.item_type(encoding).itemsize
    return Image(height=480, width=640, encoding=encoding, step=640 * size,
                 data=np.random.RandomState(2).bytes(480 * 640 * size))


def a_scan():
    return LaserScan(ranges=scan.in_millimetres(np.random.RandomState(3).randint(50, 30000, 720)), angle_min=-np.pi,
                     angle_increment=np.pi / 360, range_max=30.0)


def stream(class_of, kind, **settings):
    """A stream without its topics: what makes frames of messages, and messages of frames."""
    defaults = {name: parameter.default for name, parameter in parameters_of(kind).items()}
    topics = {'robot_topic': 'bench', 'operator_topic': 'bench'}
    return class_of(kind)('bench', {**defaults, **topics, **settings}, Link(
        1472, motion=SimpleNamespace(stands=lambda: False, pictures=lambda changed: None)))


def gather(receiver, parts_of_frames):
    """What the receiver's threads do with what came of one message's segments: the message that is published."""
    head = head_of(parts_of_frames[0][0], receiver.SEGMENT, receiver.HEAD)
    picture = receiver.begin(head)
    for records in parts_of_frames:
        picture.add(*receiver.parts(records))
    message = receiver.message(head, picture)
    receiver.shown(head, picture, message)
    return message


def cases():
    """{what is done: (f(), limit [ms] or None)}"""
    plain, packed = (stream(robot_class, 'cloud', encoding=encoding) for encoding in ('float32', 'packed'))
    image_sender, image_receiver = stream(robot_class, 'image'), stream(operator_class, 'image')
    cloud_receiver, map_sender, scan_sender = (stream(operator_class, 'cloud'), stream(robot_class, 'grid'),
                                               stream(robot_class, 'scan'))
    points, large, ranges, thermal, colour = a_cloud(), a_map(2000), a_scan(), an_image('mono16'), an_image('bgr8')
    pictures = [frame.records.copy() for frame in image_sender.frames(thermal)]
    halves = [records[::2] for records in pictures]
    chunks = [frame.records for frame in packed.frames(points)]
    grey = pixels.as_pixels(thermal.data, 480, 640, 1280, 'mono16', False)

    scans = [stream(robot_class, 'virtual_scan', select=select, base_frame='') for select in ('obstacle', 'landmark')]

    def both_scans():
        scans[0]._fans._message = None      # each cloud is another one
        for sender in scans:
            scan_frames(sender.scan(points), False, 1472)

    def changed_map():
        large.data[0] ^= 1     # an unchanged one is not split again
        return map_sender.frames(large)

    def without_pcl():
        with mock.patch.object(voxel, 'pcl', None):
            return packed.frames(points)

    return {
        'cloud of 23 040: voxels and chunks, float32': (lambda: plain.frames(points), 4.0),
        'cloud of 23 040: voxels and chunks, packed': (lambda: packed.frames(points), 4.0),
        '  the same without PCL': (without_pcl, None),
        'cloud: merge, packed': (lambda: gather(cloud_receiver, chunks), None),
        'cloud of 23 040: both virtual scans': (both_scans, 10.0),
        'map of 2000 x 2000: reduce and split': (changed_map, 20.0),
        'scan of 720: split': (lambda: scan_sender.frames(ranges), None),
        'image of 640 x 480 mono16: split': (lambda: image_sender.frames(thermal), None),
        'image of 640 x 480 bgr8: split': (lambda: image_sender.frames(colour), None),
        'image of 640 x 480 mono16: merge': (lambda: gather(image_receiver, pictures), None),
        '  the same, half of it filled': (lambda: gather(image_receiver, halves), None),
        'beside: rospy serialises that image': (lambda: thermal.serialize(io.BytesIO()), None),
        'beside: JPEG of its upper 8 bits': (lambda: cv2.imencode('.jpg', (grey >> 8).astype(np.uint8)), None),
    }


def run(log, quick=False):
    """{what: {'median': [s], 'worst': [s], 'limit': [s] or None}}; the cases take turns."""
    work, rounds = cases(), QUICK_ROUNDS if quick else ROUNDS
    times = {name: [] for name in work}
    for round_ in range(rounds + 1):
        if round_ % 10 == 0:
            log('round %d of %d' % (round_, rounds))
        for name, (function, _) in work.items():
            begun = time.perf_counter()
            function()
            times[name].append(time.perf_counter() - begun)
    return {name: {'median': statistics.median(times[name][1:]), 'worst': max(times[name][1:]),
                   'limit': limit and limit / 1e3} for name, (_, limit) in work.items()}


def table(results):
    lines = ['one message, without ROS in between',
             '%-46s %12s %12s %12s' % ('', 'median [ms]', 'worst [ms]', 'goal [ms]')]
    for name, r in results.items():
        lines.append('%-46s %12.2f %12.2f %12s' % (
            name, 1e3 * r['median'], 1e3 * r['worst'], '-' if r['limit'] is None else '%g' % (1e3 * r['limit'])))
    return '\n'.join(lines)
