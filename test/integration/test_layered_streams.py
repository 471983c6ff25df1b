#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Layered images through robot_sender and operator_receiver: real nodes, real sockets, real master."""
import collections
import importlib.util
import pathlib
import sys
import unittest
import xmlrpc.client
from typing import Any, Callable, Dict, Optional

import dynamic_reconfigure.client
import numpy as np
import rosgraph
import rospy
import rostest
from sensor_msgs.msg import Image

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from waiting import Collector, errors_logged, give_time, undisturbed, wait_for

from smokebot_udp import udpros
from smokebot_udp.codecs.wire.pixels import item_type
from smokebot_udp.msg import ImageSegment, LayeredSegment
from smokebot_udp.streams.frame_end import FIRST_MARGIN

LOADED = 300.0
"""The compiled codec is loaded within this time, compiled first where it is not yet [s]."""

PLACES = {0: '', 20: '/loss20'}
"""{loss [%]: namespace of the receiver}"""


def scene(encoding: str, k: int = 0, height: int = 120, width: int = 160) -> Any:
    """A smooth image with edges and some noise that moves with k."""
    rows, columns = np.mgrid[:height, :width]
    channels = 3 if encoding in ('bgr8', 'rgb8') else 1
    noise = np.random.RandomState(k)
    edge = 0.2 * ((columns + 3 * k) % width > 80)
    parts = [0.5 + 0.25 * np.sin((rows + 2 * k) / 17 + c) * np.cos(columns / 23) - edge
             + 0.003 * noise.randn(height, width) for c in range(channels)]
    values = np.clip(np.dstack(parts) if channels > 1 else parts[0], 0, 1)
    return (7000 + 2000 * values).astype(np.uint16) if encoding == 'mono16' else (255 * values).astype(np.uint8)


def message_of(pixels: Any, encoding: str, stamp: Any) -> Any:
    height, width = pixels.shape[:2]
    message = Image(height=height, width=width, encoding=encoding, data=pixels.tobytes(),
                    step=width * item_type(encoding).itemsize)
    message.header.stamp, message.header.frame_id = stamp, 'somewhere'
    return message


def pixels_of(message: Any) -> Any:
    kind = np.uint16 if message.encoding == 'mono16' else np.uint8
    shape = (message.height, message.width) + ((3,) if message.encoding in ('bgr8', 'rgb8') else ())
    return np.frombuffer(message.data, kind).reshape(shape)


@unittest.skipIf(importlib.util.find_spec('numba') is None, 'layered images need numba: sudo apt install python3-numba')
class LayeredStreams(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> None:
        rospy.init_node('layered_streams')
        cls.errors = errors_logged()
        cls.sources = {name: rospy.Publisher('/%s/image_raw' % name, Image, queue_size=5)
                       for name in ('thermal', 'camera')}
        cls.out = {(name, loss): Collector('%s/operator/%s' % (place, name), Image)
                   for loss, place in PLACES.items() for name in cls.sources}
        cls.settings = {name: dynamic_reconfigure.client.Client('/robot_sender/' + name, timeout=30)
                        for name in cls.sources}
        cls.carried: Dict[str, int] = {'segments': 0, 'layers': 0}
        for collector in cls.out.values():
            collector.wait_connected()
        for name, source in cls.sources.items():
            wait_for(source.get_num_connections, what='robot_sender')
            wait_for(lambda name=name: cls.receivers(name, 'segments') == len(PLACES), what='receivers of ' + name)
        wait_for(lambda: cls.receivers('thermal', 'layers') == len(PLACES), LOADED, 'receivers of layers')
        cls.counters = [udpros.Subscriber('/smokebot_udp/thermal/' + part, class_, batch_callback=cls.count(part))
                        for part, class_ in (('segments', ImageSegment), ('layers', LayeredSegment))]

        def layered() -> bool:
            cls.send('thermal', scene('mono16'), 'mono16')
            return cls.carried['layers'] > 0 and all(cls.out['thermal', loss].messages for loss in PLACES)
        wait_for(layered, LOADED, 'layered images')

    @classmethod
    def count(cls, part: str) -> Callable[..., None]:
        def add(records: Any, mask: Any) -> None:
            cls.carried[part] += int(np.count_nonzero(mask))
        return add

    @staticmethod
    def receivers(stream: str, part: str) -> int:
        """The number of operators to which robot_sender sends a part of a stream."""
        master = rosgraph.Master('/layered_streams')
        with xmlrpc.client.ServerProxy(master.lookupNode('/robot_sender')) as node:
            return sum(entry[1].endswith('operator_receiver') and
                       entry[3:5] == ['UDPROS', '/smokebot_udp/%s/%s' % (stream, part)]
                       for entry in node.getBusInfo('/layered_streams')[2])

    @classmethod
    def send(cls, stream: str, pixels: Any, encoding: str) -> Any:
        stamp = rospy.Time.now()
        cls.sources[stream].publish(message_of(pixels, encoding, stamp))
        give_time(0.05)     # the next image has another stamp, and does not replace this one
        return stamp

    def setUp(self) -> None:
        for collector in self.out.values():
            collector.clear()
        del self.errors[:]

    def shown(self, stream: str, loss: int, stamp: Any) -> Any:
        found = wait_for(lambda: self.out[stream, loss].messages.get(stamp), 10, 'an image at %d %%' % loss)
        self.assertEqual(found.header.frame_id, 'somewhere')
        return pixels_of(found)

    def code(self, stream: str, coding: Optional[str] = None, **settings: Any) -> None:
        """Change settings by the parameter server."""
        for name, value in {**settings, **({'coding': coding} if coding else {})}.items():
            path = '/robot_sender/%s/%s' % (stream, name)
            self.addCleanup(rospy.set_param, path, rospy.get_param(path))
            rospy.set_param(path, value)
            # dynamic_reconfigure shows what is in force
            wait_for(lambda name=name, value=value: self.settings[stream].get_configuration()[name] == value,
                     what='%s %r' % (name, value))

    @undisturbed(FIRST_MARGIN)
    def check_shown(self, encoding: str, k: int) -> None:
        pixels = scene(encoding, k)
        stamp = self.send('thermal', pixels, encoding)
        for loss in PLACES:
            error = self.shown('thermal', loss, stamp).astype(float) - pixels
            self.assertLess(np.sqrt((error ** 2).mean()), 0.15 * pixels.astype(float).std(), (encoding, loss))

    def test_every_encoding_is_shown_though_a_fifth_is_lost(self) -> None:
        for encoding in ('mono8', 'mono16', 'bgr8', 'rgb8'):
            for k in range(4):
                self.check_shown(encoding, k)

    def test_without_loss_on_a_fast_link_images_are_exact(self) -> None:
        def exact() -> bool:
            pixels = scene('mono16', 3)
            return bool((self.shown('thermal', 0, self.send('thermal', pixels, 'mono16')) == pixels).all())
        wait_for(exact, 30, 'an exact image')

    def test_what_stands_still_becomes_exact_though_no_image_of_it_fits(self) -> None:
        """Each image adds to what both receivers have reported as held."""
        self.code('thermal', max_bytes=6000)     # the exact image takes 11 kB
        pixels = scene('mono16', 5)

        def exact() -> bool:
            self.send('thermal', pixels, 'mono16')
            newest = [self.out['thermal', loss].messages.copy().popitem()[1] for loss in PLACES
                      if self.out['thermal', loss].messages]
            return len(newest) == len(PLACES) and all((pixels_of(message) == pixels).all() for message in newest)
        wait_for(exact, 60, 'exact images of both receivers')

    def settled(self) -> bool:
        """Whether what was sent has been counted: the last datagrams come when the image is shown already."""
        before = dict(self.carried)
        give_time(0.3)
        return self.carried == before

    @undisturbed(FIRST_MARGIN)
    def test_coding_is_switched_while_images_come(self) -> None:
        client = self.settings['thermal']
        self.addCleanup(client.update_configuration, {'coding': 'layered'})
        for coding, part, other in (('interleaved', 'segments', 'layers'), ('layered', 'layers', 'segments')) * 2:
            client.update_configuration({'coding': coding})
            wait_for(lambda coding=coding: rospy.get_param('/robot_sender/thermal/coding') == coding, what=coding)
            wait_for(self.settled, what='the last datagrams')
            before = dict(self.carried)
            for k in range(5):
                pixels = scene('mono16', k)
                stamp = self.send('thermal', pixels, 'mono16')
                for loss in PLACES:
                    error = self.shown('thermal', loss, stamp).astype(float) - pixels
                    self.assertLess(np.sqrt((error ** 2).mean()), 0.3 * pixels.astype(float).std())
            wait_for(lambda part=part, before=before: self.carried[part] > before[part], what=part)
            self.assertEqual(self.carried[other], before[other])    # a part that is not in use costs no traffic

    def test_a_part_is_advertised_only_when_it_is_needed(self) -> None:
        self.assertEqual(self.receivers('camera', 'layers'), 0)
        self.shown('camera', 20, self.send('camera', scene('bgr8'), 'bgr8'))
        self.code('camera', 'layered')
        self.shown('camera', 0, self.send('camera', scene('bgr8'), 'bgr8'))

        def advertised() -> bool:
            """The first one with the setting advertises it."""
            self.send('camera', scene('bgr8'), 'bgr8')
            return self.receivers('camera', 'layers') == len(PLACES)
        wait_for(advertised, what='receivers of layers')
        carried: Dict[str, int] = collections.Counter()
        layers = udpros.Subscriber('/smokebot_udp/camera/layers', LayeredSegment, batch_callback=(
            lambda records, mask: carried.update(layers=int(np.count_nonzero(mask)))))
        segments = udpros.Subscriber('/smokebot_udp/camera/segments', ImageSegment, batch_callback=lambda *_: None)
        for subscriber in layers, segments:
            self.addCleanup(subscriber.unregister)

        def layered() -> bool:
            """What is sent before a receiver has heard of its connection is lost."""
            stamp = self.send('camera', scene('bgr8'), 'bgr8')
            return carried['layers'] > 0 and all(stamp in self.out['camera', loss].messages for loss in PLACES)
        wait_for(layered, 30, 'layered images of both')

        def like_the_scene(k: int) -> bool:
            """A machine that interrupts the nodes shows an image before all of it has come."""
            pixels = scene('bgr8', k)
            error = self.shown('camera', 20, self.send('camera', pixels, 'bgr8')).astype(float) - pixels
            return bool(np.sqrt((error ** 2).mean()) < 10)
        for k in range(3):
            wait_for(lambda k=k: like_the_scene(k), what='image %d' % k)

    def test_what_cannot_be_layered_is_refused_and_auto_sends_it_interleaved(self) -> None:
        pixels = np.random.RandomState(1).randint(0, 256, (48, 64, 4)).astype(np.uint8)
        self.sources['thermal'].publish(message_of(pixels, '8UC4', rospy.Time.now()))
        words = "coding is layered, but encoding is '8UC4', which cannot be layered; mono8,"
        wait_for(lambda: any("stream 'thermal'" in error and '/thermal/image_raw' in error and words in error
                             for error in self.errors), what=words)
        self.code('thermal', 'auto')
        del self.errors[:]
        stamp = self.send('thermal', pixels, '8UC4')
        got = wait_for(lambda: self.out['thermal', 0].messages.get(stamp), 10, 'an image')
        self.assertEqual(got.data, pixels.tobytes())
        self.assertEqual(self.errors, [])


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'layered_streams', LayeredStreams)
