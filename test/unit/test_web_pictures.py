# SPDX-License-Identifier: BSD-3-Clause
import math
from typing import Any

import cv2
import numpy as np
import pytest
import rospy
from sensor_msgs.msg import CompressedImage, Image

from smokebot_udp.msg import ViewImage
from smokebot_udp.web.pictures import WIDTHS, Pictures, jpeg, metadata, picture_of, step_of
from smokebot_udp.web.png import encoded
from smokebot_udp.web.relayed_images import RelayedColours
from smokebot_udp.web.screen import Now
from smokebot_udp.web.stills import MOST, Stills
from smokebot_udp.web.values import value_at


def view_image(width: int = 8, height: int = 4, **fields: Any) -> Any:
    message = ViewImage(**{
        'state': 'fresh', 'age': 0.1, 'completeness': 1.0, 'error': math.nan, 'old_after': 0.5, 'frozen_after': 2.0,
        'height': height, 'width': width, 'data': bytes(range(3)) * min(width * height, 1 << 20),
        'counts_per_unit': 25.0, 'zero': -273.0, 'unit': 'degC', 'quality': '100 %', **fields})
    message.header.stamp = rospy.Time(100, 500000000)
    return message


def test_a_picture_and_what_is_known_of_it() -> None:
    picture = picture_of(view_image(old=True, poor=True, palette=bytes([1, 2, 3, 255, 0, 0]), numbers=list('12345')),
                         50.0)
    assert picture.pixels.shape == (4, 8, 3) and picture.pixels[0, 0].tolist() == [0, 1, 2]
    fields = metadata(picture, jpeg(picture.pixels, 320), 50.25, 1e9)
    assert fields['age'] == pytest.approx(0.35) and fields['stamp'] == 100.5 and fields['reason'] == 'age'
    assert fields['scale'] == {'numbers': list('12345'), 'unit': 'degC', 'colours': ['#030201', '#0000ff']}
    assert (fields['width'], fields['height'], fields['sent'], fields['error']) == (8, 4, 1e9, None)


def test_before_the_first_image_there_is_no_age() -> None:
    picture = picture_of(view_image(age=math.inf, state='frozen'), 50.0)
    assert metadata(picture, jpeg(picture.pixels, 320), 51.0, 1e9)['age'] is None


@pytest.mark.parametrize('fields', [{'data': b'123'}, {'height': 0, 'data': b''},
                                    {'height': 1 << 20, 'width': 1 << 20, 'data': b''}])
def test_a_picture_that_contradicts_itself_is_refused(fields) -> None:
    with pytest.raises(ValueError, match='a picture of'):
        picture_of(view_image(**fields), 50.0)


@pytest.mark.parametrize('width, step', [(1, 160), (160, 160), (161, 240), (1920, 1920), (8192, 1920)])
def test_widths_are_rounded_up_to_a_few_steps(width, step) -> None:
    assert step_of(width) == step and step in WIDTHS


def test_a_jpeg_is_never_larger_than_the_picture() -> None:
    pixels = np.full((48, 64, 3), 200, np.uint8)
    assert jpeg(pixels, 320)[1:] == (64, 48) and jpeg(pixels, 32)[1:] == (32, 24)
    decoded = cv2.imdecode(np.frombuffer(jpeg(pixels, 32).data, np.uint8), cv2.IMREAD_COLOR)
    assert decoded.shape == (24, 32, 3) and abs(int(decoded[0, 0, 0]) - 200) < 3


def test_each_picture_is_encoded_once_for_each_width() -> None:
    pictures = Pictures()
    assert not pictures.encode([320])
    pictures.newest = picture_of(view_image(400, 300), 50.0)
    assert not pictures.encode([]) and pictures.encode([320, 300, 160]) and not pictures.encode([160])
    current = pictures.current
    assert current is not None and set(current.encoded) == {320, 160} and current.number == 1
    assert pictures.encode([640])
    assert pictures.current is not None and set(pictures.current.encoded) == {640}
    pictures.newest = picture_of(view_image(400, 300, age=3.0), 51.0)      # the same again
    before = pictures.current.encoded[640]
    assert pictures.encode([640])
    assert pictures.current.encoded[640] is before and pictures.current.picture.age == 3.0
    pictures.newest = picture_of(view_image(400, 300, data=bytes(400 * 300 * 3)), 51.0)
    pictures.encode([640])
    assert pictures.current.encoded[640] is not before


def test_relayed_images_get_colours_and_an_age() -> None:
    colours = RelayedColours()
    image = Image(height=2, width=3, encoding='mono8', step=3, data=bytes([7] * 6))
    image.header.stamp = rospy.Time(100)
    picture = colours.picture(image, 50.0, 100.25)
    assert picture.pixels.shape == (2, 3, 3) and picture.age == 0.25 and picture.fields['state'] == 'fresh'
    data = cv2.imencode('.png', np.full((2, 3, 3), 9, np.uint8))[1].tobytes()
    assert colours.picture(CompressedImage(format='png', data=data), 50.0, 100.0).pixels[0, 0, 0] == 9
    for bad in (CompressedImage(format='jpeg', data=b'none'), Image(height=1, width=1, encoding='no', data=b'1'),
                Image(height=1 << 15, width=1 << 15, encoding='mono8', data=b'1')):
        with pytest.raises(ValueError):
            colours.picture(bad, 50.0, 100.0)


@pytest.mark.parametrize('encoding, dtype, pixel, found', [
    ('mono16', np.uint16, 7500, (27.0, 'degC', '27 degC')), ('mono16', np.uint16, 0, (None, '', 'no reading')),
    ('32FC1', np.float32, math.nan, (None, '', 'no reading')), ('mono8', np.uint8, 200, (200.0, '', '200'))])
def test_the_value_at_a_place(encoding, dtype, pixel, found) -> None:
    pixels = np.zeros((4, 6), dtype)
    pixels[3, 5] = pixel
    message = Image(height=4, width=6, encoding=encoding, step=pixels.strides[0], data=pixels.tobytes())
    answer = value_at(message, 1.0, 1.0, {'counts_per_unit': 25.0, 'zero': -273.0, 'unit': 'degC'})
    assert (answer['value'], answer['unit'], answer['text']) == found


def test_a_colour_has_no_value() -> None:
    message = Image(height=1, width=1, encoding='bgr8', step=3, data=b'\1\2\3')
    assert value_at(message, 0.0, 0.5, {})['text'] == '1, 2, 3 (bgr8)'


def test_stills_are_exact_and_the_oldest_is_forgotten() -> None:
    stills, picture = Stills(), picture_of(view_image(), 50.0)
    kept = stills.keep('ugv1', 'thermal', picture, Now(50.5, 1e9))
    type_, content = stills.get(kept['image'].rpartition('/')[2]) or ('', b'')
    pixels = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    assert type_ == 'image/png' and np.array_equal(pixels, picture.pixels) and encoded(picture.pixels) == content
    assert kept['values']['age'] == pytest.approx(0.6) and kept['values']['unit'] == 'degC'
    for _ in range(MOST):
        stills.keep('ugv1', 'thermal', picture, Now(50.5, 1e9))
    assert stills.get(kept['image'].rpartition('/')[2]) is None
    assert stills.get('../../etc/passwd') is None


