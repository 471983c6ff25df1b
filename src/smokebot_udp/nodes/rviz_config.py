# SPDX-License-Identifier: BSD-3-Clause
"""Configurations of rviz: generated from the streams, merged with the changes of the user, with a prefix of frames."""
import math
import re
import struct
from typing import Any, List, Mapping, Sequence, Tuple

import yaml

from ..streams import frame_prefix
from ..streams.config import Streams
from .rviz_displays import displays_of, images_of, tools_of

FRAMES = re.compile(r'^( *(?:Fixed|Target|Reference) Frame: )(?!<)(\S.*)$', re.MULTILINE)
"""Lines that name a frame; <Fixed Frame> is not a name."""

WIDTH, HEIGHT = 560, 883
"""Width and height of the docks at the left, together [pixel]."""

STATUS, STATUS_HEIGHT, PRIMARY = 'Status', 161, 1.8
"""The dock of the overlay, its height [pixel], and the height of the primary image in rows of the other images."""

SCENE_WIDTH = 714
"""Width that is left for the scene [pixel]."""

LEFT_AREA, TOP_AREA = 0, 2
"""Values of QInternal::DockPosition."""

VERTICAL, HORIZONTAL = 2, 1
"""Values of Qt::Orientation."""

Node = Any
"""A dock by its name, or (orientation, [(size, Node), ...])."""


def with_prefix(text: str, prefix: str) -> str:
    """The text of an .rviz file whose frames have the prefix."""
    return FRAMES.sub(lambda line: line.group(1) + frame_prefix.with_prefix(line.group(2), prefix), text)


def generated(template: str, streams: Streams) -> str:
    """The text of an .rviz file that shows the streams.

    :param template: an .rviz file with what does not depend on the streams
    """
    config = yaml.safe_load(template)
    manager, images = config['Visualization Manager'], images_of(streams)
    names = unique([STATUS, *(image.name for image in images)])
    displays = {display['Name']: display for display in manager['Displays']}
    shown = [{**image.display, 'Name': name} for image, name in zip(images, names[1:])]
    manager['Displays'] = [displays.pop(STATUS), *shown, *displays_of(streams), *displays.values()]
    manager['Global Options']['Fixed Frame'] = streams.frames.fixed
    manager['Views']['Current']['Target Frame'] = streams.frames.base
    manager['Tools'] += tools_of(streams)
    geometry = config['Window Geometry']
    geometry['QMainWindow State'] = docks_state(names)
    geometry.update({name: {'collapsed': False} for name in names})
    return str(yaml.safe_dump(config, sort_keys=False))


def unique(names: Sequence[str]) -> List[str]:
    """The names, of which none is twice."""
    found: List[str] = []
    for name in names:
        while name in found:
            name += ' image'
        found.append(name)
    return found


def merged(before: str, users: str, now: str) -> str:
    """What the user has arranged, with what has changed in the streams since.

    Displays and tools of new streams are added, those of streams that are gone are removed. What the user has removed
    stays so. All else changes where the user has left it as it was.

    :param before: the text generated last time
    :param users: the same as rviz has saved it
    :param now: the text generated now
    :raises Exception: where the user's text is no .rviz file
    """
    if now == before:
        return users
    if users == before:
        return now
    found, old, new = (yaml.safe_load(text) for text in (users, before, now))
    merge = _merged_mappings(old, found, new)
    state = [config['Window Geometry'].get('QMainWindow State') for config in (old, new)]
    if state[0] != state[1]:    # there are other docks: those that the user's does not have would float
        merge['Window Geometry']['QMainWindow State'] = state[1]
    return str(yaml.safe_dump(merge, sort_keys=False))


def _merged_mappings(old: Any, users: Any, new: Any) -> Any:
    found = dict(users)
    for key, value in new.items():
        if key not in users:
            if key not in old:
                found[key] = value
        elif users[key] == old.get(key):
            found[key] = value
        elif isinstance(value, dict) and isinstance(users[key], dict):
            found[key] = _merged_mappings(old.get(key) or {}, users[key], value)
        elif isinstance(value, list) and isinstance(users[key], list):
            found[key] = _merged_lists(old.get(key) or [], users[key], value)
    return found


def _merged_lists(old: List[Any], users: List[Any], new: List[Any]) -> List[Any]:
    """Merge displays or tools: the user's items, without those that are no longer generated, and the new ones."""
    olds, news = ({_subject(item): item for item in items} for items in (old, new))
    known = {_subject(item) for item in users}
    kept = [_merged_mappings(olds.get(_subject(item), {}), item, news[_subject(item)])
            if _subject(item) in news else item
            for item in users if _subject(item) in news or _subject(item) not in olds]
    return kept + [item for subject, item in news.items() if subject not in known and subject not in olds]


def _subject(item: Mapping[str, Any]) -> Tuple[str, str]:
    """What a display or tool is about."""
    topic = item.get('Topic') or item.get('Image Topic') or item.get('Marker Topic')
    if isinstance(topic, dict):     # later versions of rviz
        topic = topic.get('Value')
    return str(item.get('Class')), str(topic or item.get('Name', ''))


def docks_state(names: Sequence[str]) -> str:
    """What QMainWindow.saveState makes of docks at the left, as hexadecimal digits: without it, images float.

    From top to bottom: the status, the primary image, and the others, in as many columns as their number asks for.
    Without images, the status is above the scene.

    :param names: of the status, the primary image, and the others
    """
    status, primary, others = names[0], names[1:2], names[2:]
    columns = math.ceil(math.sqrt(len(others)))
    rows = [others[begin:begin + columns] for begin in range(0, len(others), columns or 1)]
    height = (HEIGHT - STATUS_HEIGHT) / (PRIMARY + len(rows))
    column: List[Tuple[int, Node]] = [(STATUS_HEIGHT, status), *((round(PRIMARY * height), name) for name in primary)]
    column += [(round(height), row[0] if len(row) == 1 else
                (HORIZONTAL, [(WIDTH // len(row), name) for name in row])) for row in rows]
    if primary:
        area, docks, scene = (LEFT_AREA, WIDTH, HEIGHT), _dock_info((VERTICAL, column)), (SCENE_WIDTH, HEIGHT)
    else:
        width = WIDTH + SCENE_WIDTH
        area, docks = (TOP_AREA, width, STATUS_HEIGHT), _dock_info((HORIZONTAL, [(width, status)]))
        scene = width, HEIGHT - STATUS_HEIGHT
    return (b'\x00\x00\x00\xff\x00\x00\x00\x00\xfd' + struct.pack('>iiii', 1, *area) + docks
            + struct.pack('>iiiiii', *scene, 4, 4, 8, 8) + b'\xfc' + struct.pack('>iii', 1, 2, 1) + _string('Tools')
            + b'\x01' + struct.pack('>iiii', 0, -1, 0, 0)).hex()


def _dock_info(node: Tuple[int, Sequence[Tuple[int, Node]]]) -> bytes:
    """Qt's QDockAreaLayoutInfo::saveState: a sequence of docks and further sequences."""
    orientation, items = node
    found, position = b'\xfc' + struct.pack('>Bi', orientation, len(items)), 0
    for size, item in items:
        place = struct.pack('>iiii', position, size, 23, 0xffffff)     # least and greatest size
        found += (b'\xfb' + _string(item) + b'\x01' + place if isinstance(item, str) else
                  b'\xfc' + place + _dock_info(item))
        position += size + 6
    return found


def _string(text: str) -> bytes:
    """Qt's QString in a QDataStream."""
    data = text.encode('utf-16-be')
    return struct.pack('>i', len(data)) + data


def remappings(transforms: Mapping[str, str]) -> List[str]:
    """rviz's arguments for transforms that are received as streams: the robot's own /tf would come over TCP.

    :param transforms: {/tf or /tf_static: the operator's topic of it}
    """
    return ['%s:=%s' % item for item in transforms.items()]

