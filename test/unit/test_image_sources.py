# SPDX-License-Identifier: BSD-3-Clause
"""What cameras publish, through an image stream's encoder and assembler."""
from typing import Any, List, Tuple

import cv2
import numpy as np
import pytest
from genpy import Time
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from evaluation.linked_encoder import LinkedEncoder
from evaluation.offline_link import Sender, assemble_all, operator_side
from smokebot_udp.mission.parameters import check
from smokebot_udp.mission.settings import Settings
from smokebot_udp.streams.encoder import Encoded
from smokebot_udp.streams.image.encoder import ImageEncoder
from smokebot_udp.streams.image.source import raw_image
from smokebot_udp.streams.segments import INFO, MAIN_PART


def noise(shape: Any, dtype: str = 'u1') -> Any:
    return np.random.RandomState(1).randint(0, 256 ** np.dtype(dtype).itemsize, shape).astype(dtype)


def image(pixels: Any, encoding: str, seconds: int = 1) -> Any:
    message = Image(height=pixels.shape[0], width=pixels.shape[1], encoding=encoding, step=pixels.strides[0],
                    data=pixels.tobytes(), is_bigendian=pixels.dtype.byteorder == '>')
    message.header.stamp, message.header.frame_id = Time(seconds, 7), 'lens'
    return message


def compressed(pixels: Any, description: str) -> Any:
    data = cv2.imencode('.png' if 'png' in description else '.jpg', pixels)[1].tobytes()
    message = CompressedImage(format=description, data=data)
    message.header.stamp, message.header.frame_id = Time(1, 7), 'lens'
    return message


def crossed(message: Any, losing: float = 0.0, **settings: Any) -> Any:
    """What is published of a message, and its mask."""
    frames = Sender('image', **{'coding': 'interleaved', **settings}).frames(message)
    random = np.random.RandomState(2)
    batches = [frame.records[random.uniform(size=len(frame)) >= losing] for frame in frames]
    assembled, = assemble_all(*operator_side('image', fill='nearest'), [part for part in batches if len(part)])
    header = assembled.message.header
    assert (header.stamp, header.frame_id) == (Time(1, 7), 'lens')
    return assembled


def pixels_of(message: Any, dtype: str = 'u1') -> Any:
    found = np.frombuffer(message.data, dtype).reshape(message.height, message.width, -1)
    return found[..., 0] if found.shape[2] == 1 else found


def test_a_compressed_image_of_sixteen_bits_is_exact() -> None:
    pixels = noise((120, 160), 'u2')
    shown = crossed(compressed(pixels, 'mono16; png compressed ')).message
    assert shown.encoding == 'mono16' and (pixels_of(shown, 'u2') == pixels).all()


def test_a_jpeg_has_its_colours() -> None:
    pixels = cv2.resize(noise((4, 4, 3)), (160, 120))
    shown = crossed(compressed(pixels, 'rgb8; jpeg compressed bgr8')).message
    assert shown.encoding == 'bgr8' and np.abs(pixels_of(shown).astype(int) - pixels).mean() < 4


@pytest.mark.parametrize('encoding, dtype', [('bayer_rggb8', 'u1'), ('bayer_grbg16', '<u2'), ('bayer_bggr16', '>u2')])
def test_a_mosaic_is_exact_and_its_colours_are_not_mixed(encoding: str, dtype: str) -> None:
    mosaic = noise((120, 160), dtype)
    shown = crossed(image(mosaic, encoding)).message
    assert shown.encoding == encoding and (pixels_of(shown, dtype) == mosaic).all()
    flat = np.tile(np.array([[10, 100], [100, 200]], dtype), (60, 80))
    lossy = crossed(image(flat, encoding), 0.5)
    assert (pixels_of(lossy.message, dtype) == flat).all() and 0.2 < lossy.completeness < 0.8
    mask = lossy.mask()
    assert mask.shape == (120, 160) and 0.2 < (mask == 255).mean() < 0.8
    assert (mask[::2, ::2] == mask[1::2, 1::2]).all()


def test_a_mosaic_is_remembered_like_other_images() -> None:
    assembler, settings = operator_side('image', integrate='always', fill='nearest')
    mosaic = noise((120, 160), 'u2')
    for seconds in (1, 2):
        frames = Sender('image', coding='interleaved').frames(image(mosaic, 'bayer_rggb16', seconds))
        batches = [frame.records[::seconds] for frame in frames]
        shown, = assemble_all(assembler, settings, batches, float(seconds))
    assert shown.completeness < 0.7 and (pixels_of(shown.message, 'u2') == mosaic).all()


@pytest.mark.parametrize('settings', [{'debayer': True}, {'scale': 2}])
def test_a_mosaic_in_colours(settings: Any) -> None:
    mosaic = np.tile(np.uint8([[200, 100], [100, 10]]), (60, 80))
    shown = crossed(image(mosaic, 'bayer_rggb8'), **settings).message
    scale = settings.get('scale', 1)
    assert (shown.encoding, shown.height, shown.width) == ('bgr8', 120 // scale, 160 // scale)
    assert (pixels_of(shown)[4:-4, 4:-4] == [10, 100, 200]).all()


@pytest.mark.parametrize('encoding, luma', [('yuv422', slice(1, None, 2)), ('yuv422_yuy2', slice(0, None, 2))])
def test_yuv(encoding: str, luma: Any) -> None:
    pixels = np.full((120, 320), 128, np.uint8)
    pixels[:, luma] = 126     # grey: (126 - 16) * 255 / 219 = 128
    message = image(pixels, encoding)
    message.width = 160
    shown = crossed(message).message
    assert shown.encoding == 'bgr8' and set(np.unique(pixels_of(shown))) <= {127, 128, 129}


@pytest.mark.parametrize('source', [image(noise((120, 160)), 'mono8'),
                                    compressed(noise((120, 160)), 'mono8; png compressed ')])
def test_a_region_is_cut(source: Any) -> None:
    shown = crossed(source, region='30, 20, 100, 50').message
    assert (pixels_of(shown) == noise((120, 160))[20:70, 30:130]).all()
    assert (pixels_of(crossed(source, region='150 110 100 50').message) == noise((120, 160))[110:, 150:]).all()
    scaled = crossed(source, region='30, 20, 100, 50', scale=2).message
    assert (scaled.height, scaled.width) == (25, 50)


def test_a_region_of_a_mosaic_keeps_its_pattern() -> None:
    mosaic = noise((120, 160))
    shown = crossed(image(mosaic, 'bayer_rggb8'), region='31, 21, 100, 50').message
    assert (pixels_of(shown) == mosaic[20:70, 30:130]).all() and shown.encoding == 'bayer_rggb8'


@pytest.mark.parametrize('message, settings, problem', [
    (image(noise((120, 160)), 'mono8'), {'region': '160, 0, 5, 5'}, 'region is 160, 0, 5, 5: nothing of it'),
    (image(noise((121, 161)), 'bayer_rggb8'), {'region': '160, 0, 5, 5'},
     'region is 160, 0, 5, 5: no whole cell of 2 x 2 pixels of it is in an image of 161 x 121'),
    (image(noise((48, 1)), 'bayer_rggb8'), {}, 'encoding is bayer_rggb8, but the image is 1 x 48 pixels'),
    (image(noise((1, 64)), 'bayer_gbrg8'), {'region': '0, 0, 9, 9'}, 'but the image is 64 x 1 pixels, less than one'),
    (image(noise((4, 3, 2)), 'yuv422'), {}, 'encoding is yuv422, but the width of 3 pixels is odd'),
    (CompressedImage(format='jpeg', data=b'\xff\xd8'), {}, 'truncated')])
def test_bad_images_are_refused(message: Any, settings: Any, problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        Sender('image', coding='interleaved', **settings).frames(message)


@pytest.mark.parametrize('step', [0, 160 * 120])
@pytest.mark.parametrize('coding', [{}, {'scale': 2}, {'region': '30, 20, 100, 50'}])
def test_a_step_that_contradicts_the_data_is_told_and_not_used(step: int, coding: Any) -> None:
    odd, sender = image(noise((120, 160)), 'mono8'), Sender('image', coding='interleaved', **coding)
    wanted = [frame.rows.tobytes() for frame in sender.frames(odd)]
    odd.step = step
    assert [frame.rows.tobytes() for frame in sender.frames(odd)] == wanted and odd.step == step
    assert list(sender.warnings) == ['step is %d, by the data it is 160' % step]


def test_a_format_that_contradicts_the_pixels_is_told() -> None:
    sender = Sender('image', coding='interleaved')
    sender.frames(compressed(np.full((8, 8), 255, np.uint8), 'mono16; jpeg compressed '))
    warning, = sender.warnings
    assert 'what was above 255 is lost' in warning


def test_originals_of_cameras_are_images() -> None:
    deep = noise((12, 16), 'u2')
    found = raw_image(compressed(deep, 'mono16; png compressed '))
    assert (found.encoding, found.header.frame_id) == ('mono16', 'lens') and (pixels_of(found, 'u2') == deep).all()
    mosaic = image(noise((12, 16)), 'bayer_rggb8')
    assert raw_image(mosaic) is mosaic
    yuv = image(np.full((12, 32), 128, np.uint8), 'yuv422')
    yuv.width = 16
    assert raw_image(yuv).encoding == 'bgr8' and raw_image(yuv).width == 16
    assert raw_image(calibration()) == calibration()


def test_a_wrong_region_is_refused_in_settings() -> None:
    with pytest.raises(ValueError, match='region is'):
        ImageEncoder.check(check({'robot_topic': '/in', 'region': '1, 2'}, ImageEncoder.PARAMETERS))


# --- camera_info

def calibration() -> Any:
    info = CameraInfo(height=120, width=160, K=[200.0, 0.0, 79.5, 0.0, 200.0, 59.5, 0.0, 0.0, 1.0])
    info.header.stamp = Time(1, 7)
    return info


def with_calibration(message: Any, **changes: Any) -> Tuple[Encoded, List[str]]:
    """What an encoder that took a calibration makes of an image, and its warnings."""
    settings = Settings(check({'robot_topic': '/camera/image', 'coding': 'interleaved', **changes},
                              ImageEncoder.PARAMETERS))
    encoder = LinkedEncoder(ImageEncoder(settings))
    wanted = bool(changes.get('camera_info'))
    assert {topic: class_._type for topic, class_ in encoder.sources(settings).items()} == (
        {'/camera/camera_info': 'sensor_msgs/CameraInfo'} if wanted else {})
    assert encoder.takes(calibration()) == wanted and not encoder.takes(message)
    encoded = encoder.encoded(message, settings)
    assert encoded.frames
    return encoded, list(encoder.warnings)


@pytest.mark.parametrize('scale', [1, 2])
def test_each_image_has_its_calibration(scale: int) -> None:
    settings = {'camera_info': True, 'scale': scale, 'region': '20, 10, 80, 40'}
    message = image(noise((120, 160)), 'mono8')
    frames = with_calibration(message, **settings)[0].beside
    assembler, of = operator_side('image', camera_info=True)
    assert set(assembler.subscribed()) == set(assembler.SEGMENTS)
    for with_info in (False, True):
        if with_info:
            for frame in frames:
                assembler.receive(frame.records, np.ones(len(frame), bool), 0.0, INFO)
        message.header.stamp.secs += with_info
        batches = [frame.records for frame in Sender('image', coding='interleaved', **settings).frames(message)]
        assembled, = assemble_all(assembler, of, batches, float(with_info), part=MAIN_PART)
        if not with_info:
            overtaken = assembled
            assert overtaken.camera_info() is None
            assert 'camera_info' in (assembler.problem(of, 0.0) or '')
    found = assembled.camera_info()
    assert overtaken.camera_info() == found      # it came after the first image, which has it as well
    assert (found.height, found.width) == (assembled.message.height, assembled.message.width) == (40 // scale,
                                                                                               80 // scale)
    assert found.K[2] == (59.5 + 0.5) / scale - 0.5 and found.K[0] == 200 / scale
    assert assembler.problem(of, 0.0) is None


def test_without_the_setting_none_is_sent_or_received() -> None:
    assert not with_calibration(image(noise((120, 160)), 'mono8'))[0].beside
    assembler, _ = operator_side('image')
    assert INFO not in assembler.subscribed()


def test_a_calibration_of_another_size_is_named_and_the_image_is_sent() -> None:
    encoded, warnings = with_calibration(image(noise((60, 80)), 'mono8'), camera_info=True)
    assert not encoded.beside
    assert 'camera_info is of 160 x 120 pixels, the image has 80 x 60' in warnings[0]


def test_a_calibration_that_is_no_number_is_named_and_the_image_is_sent() -> None:
    settings = Settings(check({'robot_topic': '/camera/image', 'coding': 'interleaved', 'camera_info': True},
                              ImageEncoder.PARAMETERS))
    encoder, info = LinkedEncoder(ImageEncoder(settings)), calibration()
    info.D = [0.5, float('nan')]
    assert encoder.takes(info)
    encoded = encoder.encoded(image(noise((120, 160)), 'mono8'), settings)
    assert encoded.frames and not encoded.beside
    assert list(encoder.warnings) == ['camera_info has D: 0.5, nan. It is not sent']
