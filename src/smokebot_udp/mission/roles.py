# SPDX-License-Identifier: BSD-3-Clause
"""The roles of streams: what they are for, whatever they are called, so that a focus fits every robot."""
import re
from typing import Any, Dict, Mapping, Set

from .parameters import works_in_every_focus

PRIMARY_IMAGE, SECONDARY_IMAGE, OBSTACLES, LANDMARKS, MAP, CLOUD, STATE = ROLES = (
    'primary_image', 'secondary_image', 'obstacles', 'landmarks', 'map', 'cloud', 'state')
"""primary_image is what one drives by; landmarks are scans for localisation only; state is everything small."""

BY_TYPE = {'image': SECONDARY_IMAGE, 'grid': MAP, 'cloud': CLOUD, 'scan': OBSTACLES, 'virtual_scan': OBSTACLES}
"""{type of a stream: its role}; of relays BY_MESSAGE says it."""

BY_MESSAGE = {'sensor_msgs/Image': SECONDARY_IMAGE, 'sensor_msgs/CompressedImage': SECONDARY_IMAGE,
              'sensor_msgs/LaserScan': OBSTACLES, 'sensor_msgs/Range': OBSTACLES, 'nav_msgs/OccupancyGrid': MAP,
              'map_msgs/OccupancyGridUpdate': MAP, 'sensor_msgs/PointCloud2': CLOUD}
"""{type of a relay's messages: its role}; all others are STATE."""

AHEAD = {'front', 'forward', 'thermal', 'ir', 'infrared', 'flir', 'main', 'drive', 'driving'}
ASIDE = {'rear', 'back', 'left', 'right', 'side', 'arm', 'gripper', 'hand', 'down', 'bottom', 'top', 'up', 'depth'}
"""Words in the names of images that are likely, and unlikely, to be the one to drive by."""

COARSER = {'rate': min, 'repeat_rate': min, 'max_bitrate': min, 'enabled': min, 'scale': max, 'leaf_size': max}
"""{setting: which of two values sends less}. A role never asks for more than streams.yaml has: there the user says what
is enough of his own sensors."""


def roles_of(streams: Mapping[str, Mapping[str, Any]]) -> Dict[str, str]:
    """The role of each stream: as given, or by its type and, of images, by its name and the order in the file.

    :param streams: {name: {setting: value}}, as streams.yaml has them
    :return: {name: one of ROLES}; empty where a stream has none, as it works in every focus
    """
    roles = {name: str(settings.get('role') or _usual(settings)) for name, settings in streams.items()}
    if PRIMARY_IMAGE not in roles.values():
        images = [name for name, settings in streams.items()
                  if roles[name] == SECONDARY_IMAGE and settings['type'] == 'image' and not settings.get('role')]
        if images:      # min and max: of equals the first
            roles[min(images, key=lambda name: _rank(words_of(name)))] = PRIMARY_IMAGE
    return roles


def _usual(settings: Mapping[str, Any]) -> str:
    if works_in_every_focus(settings):
        return ''
    if settings.get('select') == 'landmark':
        return LANDMARKS
    return BY_TYPE.get(settings['type']) or BY_MESSAGE.get(str(settings.get('message_type')), STATE)


def _rank(words: Set[str]) -> int:
    """How unlikely an image with these words in its name is to be the one to drive by."""
    return 2 if words & ASIDE else 0 if words & AHEAD else 1


def words_of(name: str) -> Set[str]:
    """The words in the name of a stream or topic, in lower case: front and rgb of FrontRGB_2."""
    return {word.lower() for word in re.findall('[A-Z]+(?![a-z])|[A-Z]?[a-z]+', name)}


def limited(setting: str, value: Any, configured: Any) -> Any:
    """The value of a setting that a role gives a stream which has another one in streams.yaml."""
    return COARSER[setting](value, configured) if setting in COARSER else value
