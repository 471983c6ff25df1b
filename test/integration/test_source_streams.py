#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""What cameras publish, through robot_sender and operator_receiver without loss and at 20 %, with its calibration."""
import pathlib
import sys
import unittest
from typing import Any, Callable, Dict, List, Set

import cv2
import numpy as np
import rospy
import rostest
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from waiting import Collector, errors_logged, is_sent_here, undisturbed, wait_for

from smokebot_udp.streams.frame_end import FIRST_MARGIN

PLACES = {0: '', 20: '/loss20'}
"""{loss [%]: namespace of the receiver}"""

IMAGES = 12
"""That are sent in each test: at 20 % loss all of them are shown, of less than all their segments."""

MAX_ERROR = {0: 0.0, 20: 3.0}
"""{loss [%]: mean error of smooth images}: lost pixels are filled [count]"""


def smooth(number: int, height: int = 240, width: int = 320) -> Any:
    """(height, width) float, 0 to 200: a gradient that moves slowly."""
    rows, columns = np.mgrid[:height, :width]
    return 100 + 60 * np.sin((rows + number) / 40) + 40 * np.cos((columns - number) / 50)


def colours(number: int) -> Any:
    """(240, 320, 3) uint8, blue, green, red: they differ clearly."""
    grey = smooth(number)
    return np.dstack([grey, 0.5 * grey, 220 - grey]).astype(np.uint8)


def calibration(height: int, width: int, focal: float) -> CameraInfo:
    return CameraInfo(height=height, width=width, distortion_model='plumb_bob', D=[0.1, 0.0, 0.0, 0.0, 0.0],
                      K=[focal, 0.0, width / 2 - 0.5, 0.0, focal, height / 2 - 0.5, 0.0, 0.0, 1.0],
                      R=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
                      P=[focal, 0.0, width / 2 - 0.5, 0.0, 0.0, focal, height / 2 - 0.5, 0.0, 0.0, 0.0, 1.0, 0.0])


def raw(pixels: Any, encoding: str) -> Image:
    return Image(height=pixels.shape[0], width=pixels.shape[1], encoding=encoding, step=pixels.strides[0],
                 data=pixels.tobytes())


def compressed(pixels: Any, kind: str, description: str) -> CompressedImage:
    return CompressedImage(format=description, data=cv2.imencode(kind, pixels)[1].tobytes())


def pixels_of(message: Any) -> Any:
    """(height, width) or (height, width, 3) array."""
    dtype = np.uint16 if message.encoding == 'mono16' or message.encoding.endswith('16') else np.uint8
    found = np.frombuffer(message.data, dtype).reshape(message.height, message.width, -1)
    return found[..., 0] if found.shape[2] == 1 else found


class Camera:
    """A camera and what is shown of it.

    :param topic: of its images
    :param class_: of its messages
    :param name: of its namespace
    """

    def __init__(self, topic: str, class_: Any, name: str) -> None:
        self.publisher = rospy.Publisher(topic, class_, queue_size=5)
        self.infos = rospy.Publisher('/%s/camera_info' % name, CameraInfo, queue_size=5)
        self.shown = {loss: Collector('%s/operator/%s/image_raw' % (place, name), Image)
                      for loss, place in PLACES.items()}

    def wait_connected(self) -> None:
        wait_for(self.publisher.get_num_connections, what='robot_sender')
        for collector in self.shown.values():
            collector.wait_connected()

    def publish(self, message: Any) -> Any:
        """Publish an image of now: its stamp."""
        message.header.stamp, message.header.frame_id = rospy.Time.now(), 'lens'
        self.publisher.publish(message)
        return message.header.stamp

    def show(self, message: Any) -> Dict[int, Any]:
        """Publish an image: what is shown of it at each loss."""
        stamp = self.publish(message)
        for loss, collector in self.shown.items():
            wait_for(lambda at=collector: stamp in at.messages, 20, 'an image at %d %% loss' % loss)
        found = {loss: collector.messages[stamp] for loss, collector in self.shown.items()}
        assert {shown.header.frame_id for shown in found.values()} == {'lens'}
        return found


class SourceStreams(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> None:
        rospy.init_node('source_streams')
        cls.errors = errors_logged()
        wait_for(lambda: is_sent_here('/rosout', '/robot_sender'), 60, "the robot's log")
        cls.jpeg = Camera('/front/image_raw/compressed', CompressedImage, 'front')
        cls.png = Camera('/thermal/image_raw/compressed', CompressedImage, 'thermal')
        cls.mosaic = Camera('/left/image_raw', Image, 'left')
        cls.yuv = Camera('/rear/image_raw', Image, 'rear')
        for camera in (cls.jpeg, cls.png, cls.mosaic, cls.yuv):
            camera.wait_connected()

            def shown(camera: Camera = camera) -> bool:
                """Whether all receivers are connected: an image sent before is lost."""
                camera.publish(raw(np.zeros((240, 320), np.uint8), 'bayer_rggb8') if camera in (cls.mosaic, cls.yuv)
                               else compressed(np.zeros((240, 320), np.uint8), '.jpg', 'jpeg'))
                return all(collector.messages for collector in camera.shown.values())
            wait_for(shown, 60, 'a first image')

    @undisturbed(FIRST_MARGIN)      # a datagram that is later is not waited for
    def check_shown(self, camera: Camera, message: Any, check: Callable[[int, Any], None]) -> None:
        """Publish an image, and check what is shown of it at each loss."""
        for loss, shown in camera.show(message).items():
            check(loss, shown)

    def check_error(self, loss: int, shown: Any, wanted: Any) -> None:
        error = np.abs(pixels_of(shown).astype(float) - wanted).mean()
        self.assertLessEqual(error, MAX_ERROR[loss] * (100 if shown.encoding == 'mono16' else 1), loss)

    def test_jpeg(self) -> None:
        for number in range(IMAGES):
            message = compressed(colours(number), '.jpg', 'rgb8; jpeg compressed bgr8')
            wanted = cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_COLOR)

            def check(loss: int, shown: Any, wanted: Any = wanted) -> None:
                self.assertEqual((shown.encoding, shown.height, shown.width), ('bgr8', 240, 320))
                self.check_error(loss, shown, wanted)
            self.check_shown(self.jpeg, message, check)

    def test_png_of_16_bits(self) -> None:
        for number in range(IMAGES):
            wanted = (100 * smooth(number) + 7000).astype(np.uint16)

            def check(loss: int, shown: Any, wanted: Any = wanted) -> None:
                self.assertEqual(shown.encoding, 'mono16')
                self.check_error(loss, shown, wanted)
            self.check_shown(self.png, compressed(wanted, '.png', 'mono16; png compressed '), check)

    def test_bayer(self) -> None:
        places = np.tile([[0.1, 0.5], [0.5, 1.0]], (120, 160))      # mixed colours would be far off
        for number in range(IMAGES):
            wanted = (smooth(number) * places).astype(np.uint8)

            def check(loss: int, shown: Any, wanted: Any = wanted) -> None:
                self.assertEqual((shown.encoding, shown.step), ('bayer_rggb8', 320))
                self.check_error(loss, shown, wanted)
            self.check_shown(self.mosaic, raw(wanted, 'bayer_rggb8'), check)

    def test_yuv_of_a_region_scaled(self) -> None:
        for number in range(IMAGES):
            grey = smooth(number)
            pixels = np.full((240, 320, 2), 128, np.uint8)
            pixels[..., 1] = np.rint(16 + grey * 219 / 255)
            part = grey[20:220, 40:280].reshape(100, 2, 120, 2).mean(axis=(1, 3))

            def check(loss: int, shown: Any, part: Any = part) -> None:
                self.assertEqual((shown.encoding, shown.height, shown.width), ('bgr8', 100, 120))
                error = np.abs(pixels_of(shown) - part[..., np.newaxis]).mean()
                self.assertLess(error, MAX_ERROR[loss] + 1.5)   # YUV of 8 bits is not exact
            self.check_shown(self.yuv, raw(pixels, 'yuv422'), check)

    def check_matched(self, camera: Camera, name: str, message: Any, scales: Any = (1,)) -> Dict[int, Set[float]]:
        """Every shown image has its calibration, of its size: {loss: focal lengths in terms of the width}."""
        height, width = getattr(message, 'height', 240), getattr(message, 'width', 320)
        infos = {loss: Collector('%s/operator/%s/camera_info' % (place, name), CameraInfo)
                 for loss, place in PLACES.items()}
        wait_for(camera.infos.get_num_connections, what='robot_sender')
        for collector in infos.values():
            collector.wait_connected()

        def send(focal: float) -> Any:
            info = calibration(height, width, focal)
            info.header.stamp = rospy.Time.now()
            camera.infos.publish(info)
            return camera.show(message)

        def known() -> bool:
            """Whether the robot has the camera's message: images go before it on another connection."""
            send(400.0)
            return all(collector.messages for collector in infos.values())
        wait_for(known, 60, 'camera_info')
        shown: List[Dict[int, Any]] = []
        for scale in scales:
            if len(scales) > 1:
                rospy.set_param('/robot_sender/yuv/scale', scale)
                wait_for(lambda of=scale: shown.append(send(400.0)) or shown[-1][0].width == 240 // of, 20, 'the scale')
            shown.extend(send(400.0) for _ in range(IMAGES))
        lengths: Dict[int, Set[float]] = {}
        for loss, collector in infos.items():
            images = [found[loss] for found in shown]
            wait_for(lambda at=collector, of=images: {image.header.stamp for image in of} <= set(at.messages), 20,
                     'the camera_info of all images at %d %%' % loss)
            for image in images:
                info = collector.messages[image.header.stamp]
                self.assertEqual((info.height, info.width, info.header.frame_id), (image.height, image.width, 'lens'))
                # the camera looks along the middle of the image, and so along that of the region
                self.assertEqual((info.K[2], info.K[5]), (image.width / 2 - 0.5, image.height / 2 - 0.5))
                self.assertEqual(info.D, (0.1, 0.0, 0.0, 0.0, 0.0))
            lengths[loss] = {collector.messages[image.header.stamp].K[0] / image.width for image in images}
        return lengths

    def test_every_shown_image_has_its_camera_info(self) -> None:
        for camera, name, message in (
                (self.jpeg, 'front', compressed(colours(0), '.jpg', 'rgb8; jpeg compressed bgr8')),
                (self.mosaic, 'left', raw(smooth(0).astype(np.uint8), 'bayer_rggb8'))):
            self.assertEqual(self.check_matched(camera, name, message), {loss: {400.0 / 320} for loss in PLACES})

    def test_camera_info_is_scaled_and_cut_with_its_image_while_the_scale_changes(self) -> None:
        self.addCleanup(rospy.set_param, '/robot_sender/yuv/scale', 2)
        rospy.wait_for_service('/robot_sender/yuv/set_parameters', 60)
        message = raw(np.full((240, 320, 2), 128, np.uint8), 'yuv422')
        # the focal length in terms of the width is that of the region, whatever the scale is
        self.assertEqual(self.check_matched(self.yuv, 'rear', message, (2, 4, 1)),
                         {loss: {400.0 / 240} for loss in PLACES})

    def test_images_are_published_compressed(self) -> None:
        outputs = {name: Collector('/operator/%s/image_raw/compressed' % name, CompressedImage)
                   for name in ('front', 'thermal')}
        for collector in outputs.values():
            collector.wait_connected()
        deep = (100 * smooth(0) + 7000).astype(np.uint16)
        for camera, name, message, description in (
                (self.jpeg, 'front', compressed(colours(0), '.jpg', 'rgb8; jpeg compressed bgr8'),
                 'bgr8; jpeg compressed bgr8'),
                (self.png, 'thermal', compressed(deep, '.png', 'mono16; png compressed '), 'mono16; png compressed ')):
            shown = camera.show(message)[0]
            found = wait_for(lambda at=outputs[name], stamp=shown.header.stamp: at.messages.get(stamp), 20, name)
            self.assertEqual((found.format, found.header.frame_id), (description, 'lens'))
            decoded = cv2.imdecode(np.frombuffer(found.data, np.uint8), cv2.IMREAD_UNCHANGED)
            error = np.abs(decoded.astype(float) - pixels_of(shown)).mean()
            self.assertLessEqual(error, 4 if name == 'front' else 0)

    def test_a_truncated_image_is_told_of(self) -> None:
        del self.errors[:]
        whole = compressed(colours(0), '.jpg', 'jpeg')
        self.jpeg.publish(CompressedImage(format='jpeg', data=whole.data[:len(whole.data) // 2]))
        wait_for(lambda: any("stream 'jpeg'" in error and 'truncated' in error for error in list(self.errors)), 20,
                 'an error')

    def test_a_source_changes_its_type(self) -> None:
        shown = Collector('/operator/either/image_raw', Image)
        shown.wait_connected()
        wanted = (100 * smooth(0) + 7000).astype(np.uint16)
        deep = compressed(wanted, '.png', 'mono16; png compressed ')
        for class_, message in ((CompressedImage, deep), (Image, raw(wanted, 'mono16')), (CompressedImage, deep)):
            publisher = rospy.Publisher('/either/image_raw', class_, queue_size=5)
            self.addCleanup(publisher.unregister)
            shown.clear()

            def comes(to: Any = publisher, of: Any = message) -> Any:
                """Any image, whole: rospy may close a connection that it made just before."""
                of.header.stamp = rospy.Time.now()
                to.publish(of)
                found = shown.newest()
                return found is not None and np.array_equal(pixels_of(found), wanted)
            wait_for(comes, 60, 'an image of the new type')
            publisher.unregister()


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'source_streams', SourceStreams)
