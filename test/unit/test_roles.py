# SPDX-License-Identifier: BSD-3-Clause
from typing import Any, Dict, List

import pytest

from smokebot_udp.mission.roles import limited, roles_of, words_of


def image(**settings: Any) -> Dict[str, Any]:
    return {'type': 'image', **settings}


def relay(message_type: str, **settings: Any) -> Dict[str, Any]:
    return {'type': 'relay', 'message_type': message_type, **settings}


def test_roles_by_type() -> None:
    assert roles_of({
        'a': image(), 'b': image(), 'c': {'type': 'grid'}, 'd': {'type': 'cloud'}, 'e': {'type': 'scan'},
        'f': {'type': 'virtual_scan', 'select': 'obstacle'}, 'g': {'type': 'virtual_scan', 'select': 'landmark'},
        'h': relay('sensor_msgs/Imu'), 'i': relay('sensor_msgs/CompressedImage'), 'j': relay('sensor_msgs/LaserScan'),
        'k': relay('smokebot_udp/LinkStatus'), 'l': relay('std_msgs/Empty', reliable=True), 'm': {'type': 'command'}
    }) == {'a': 'primary_image', 'b': 'secondary_image', 'c': 'map', 'd': 'cloud', 'e': 'obstacles', 'f': 'obstacles',
           'g': 'landmarks', 'h': 'state', 'i': 'secondary_image', 'j': 'obstacles', 'k': '', 'l': '', 'm': ''}


@pytest.mark.parametrize('names, primary', [
    (['a', 'b'], 'a'), (['rear', 'cam'], 'cam'), (['rear', 'cam', 'front'], 'front'),
    (['arm_rgb', 'LeftCam'], 'arm_rgb'), (['camera', 'thermal'], 'thermal'), (['thermal', 'camera'], 'thermal'),
    (['depth', 'webcam0'], 'webcam0'), (['backpack', 'x'], 'backpack'), ([], '')])
def test_the_primary_image_by_name_and_order(names: List[str], primary: str) -> None:
    roles = roles_of({name: image() for name in names})
    assert ''.join(name for name, role in roles.items() if role == 'primary_image') == primary


def test_a_role_that_is_given_counts() -> None:
    assert roles_of({'front': image(), 'arm': image(role='primary_image')}) == {
        'front': 'secondary_image', 'arm': 'primary_image'}
    assert roles_of({'front': image(role='secondary_image'), 'arm': image()}) == {
        'front': 'secondary_image', 'arm': 'primary_image'}
    assert roles_of({'a': {'type': 'grid', 'role': 'obstacles'}, 'b': relay('std_msgs/Empty', role='primary_image'),
                     'c': image()}) == {'a': 'obstacles', 'b': 'primary_image', 'c': 'secondary_image'}


def test_words() -> None:
    assert words_of('FrontRGB_2') == {'front', 'rgb'} and words_of('rear_cam1') == {'rear', 'cam'}
    assert words_of('backpack') == {'backpack'} and words_of('') == set()


@pytest.mark.parametrize('setting, value, configured, found', [
    ('rate', 5.0, 10.0, 5.0), ('rate', 10.0, 5.0, 5.0), ('scale', 2, 4, 4), ('scale', 2, 1, 2),
    ('enabled', True, False, False), ('enabled', False, True, False), ('leaf_size', 0.1, 0.0, 0.1),
    ('weight', 1.0, 9.0, 1.0)])
def test_a_role_sends_no_more_than_configured(setting: str, value: Any, configured: Any, found: Any) -> None:
    assert limited(setting, value, configured) == found
