# SPDX-License-Identifier: BSD-3-Clause
"""Originals as files: PNG (8 and 16 bits), TIFF (32FC1) or PCD, with a description in YAML beside it. Nothing is
rounded: reading a file gives the values of the message."""
import contextlib
import os
import re
import tempfile
from typing import Any, Dict, Iterator, List, Mapping, Tuple

import cv2
import numpy as np
import yaml
from sensor_msgs.msg import Image, PointField

from ..arrays import Array
from ..codecs.wire.compressed import PNG_OPTIONS
from ..codecs.wire.pixels import image_pixels

PCD_TYPES = {PointField.INT8: ('I', 1), PointField.UINT8: ('U', 1), PointField.INT16: ('I', 2),
             PointField.UINT16: ('U', 2), PointField.INT32: ('I', 4), PointField.UINT32: ('U', 4),
             PointField.FLOAT32: ('F', 4), PointField.FLOAT64: ('F', 8)}
"""{datatype: (TYPE, SIZE)}"""

SWAPPED = {'rgb8': cv2.COLOR_RGB2BGR, 'rgba8': cv2.COLOR_RGBA2BGRA}
"""OpenCV writes colours as b, g, r."""


def file_name(*parts: str) -> str:
    """A file's name without its end: the parts that are not empty, with _ between them and for odd characters."""
    return '_'.join(re.sub(r'[^\w.-]', '_', part) for part in parts if part)


def file_of(message: Any) -> Tuple[str, bytes]:
    """(end of the name, content) of the file of an Image or PointCloud2.

    :raises ValueError: saying why there can be none
    """
    return image_file(message) if message._type == Image._type else ('.pcd', pcd(message))


def image_file(message: Any) -> Tuple[str, bytes]:
    """As `file_of`, of an Image."""
    pixels = image_pixels(message)
    native: Array = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder('='))
    if message.encoding in SWAPPED:
        native = cv2.cvtColor(native, SWAPPED[message.encoding])
    end = '.tiff' if native.dtype.kind == 'f' else '.png'
    try:
        done, content = cv2.imencode(end, native, PNG_OPTIONS if end == '.png' else ())
    except cv2.error:       # as of two channels
        done = False
    if not done:
        raise ValueError('OpenCV cannot write an image %s as %s' % (message.encoding, end))
    return end, content.tobytes()


def pcd(message: Any) -> bytes:
    """A PointCloud2 as a binary PCD file of version 0.7, its fields and padding as they are.

    :raises ValueError: its fields overlap, or it is big-endian
    """
    if message.is_bigendian and len(message.data):
        raise ValueError('a big-endian cloud cannot be written as PCD')
    if len(message.data) != message.height * message.row_step:
        raise ValueError('its data have %d bytes, height x row_step is %d x %d' % (
            len(message.data), message.height, message.row_step))
    fields = _pcd_fields(message)
    points = np.frombuffer(message.data, np.uint8).reshape(message.height, message.row_step)
    used = points[:, :message.width * message.point_step]
    columns = [' '.join(column) for column in zip(*fields)] if fields else [''] * 4
    head = ('# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS %s\nSIZE %s\nTYPE %s\nCOUNT %s\n'
            'WIDTH %d\nHEIGHT %d\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS %d\nDATA binary\n' % (
                *columns, message.width, message.height, message.width * message.height))
    return head.encode() + used.tobytes()


def _pcd_fields(message: Any) -> List[Tuple[str, str, str, str]]:
    """(name, SIZE, TYPE, COUNT) of each field and of what is between them, which PCL calls _."""
    found: List[Tuple[str, str, str, str]] = []
    at = 0
    for field in sorted(message.fields, key=lambda field: field.offset):
        if field.datatype not in PCD_TYPES:
            raise ValueError('the type of its field %r is %d' % (field.name, field.datatype))
        if field.offset < at:
            raise ValueError('its field %r overlaps another one' % field.name)
        kind, size = PCD_TYPES[field.datatype]
        count = max(1, field.count)
        if field.offset > at:
            found.append(('_', '1', 'U', str(field.offset - at)))
        found.append((file_name(field.name) or '_', str(size), kind, str(count)))
        at = field.offset + size * count
    if message.point_step < at:
        raise ValueError('its fields take %d bytes, point_step is %d' % (at, message.point_step))
    if message.point_step > at:
        found.append(('_', '1', 'U', str(message.point_step - at)))
    return found


def described(message: Any, pose: Any, more: Mapping[str, Any]) -> Dict[str, Any]:
    """What the YAML file says of an original.

    :param pose: geometry_msgs/TransformStamped of its frame; None: unknown
    :param more: goes first
    """
    header = message.header
    found: Dict[str, Any] = {
        **more, 'stamp': {'secs': header.stamp.secs, 'nsecs': header.stamp.nsecs}, 'frame_id': header.frame_id,
        'type': message._type, 'width': message.width, 'height': message.height}
    if message._type == Image._type:
        found['encoding'] = message.encoding
    if pose is None:
        found['pose'] = 'unknown'
        return found
    moved, turned = pose.transform.translation, pose.transform.rotation
    found['pose'] = {'frame_id': pose.header.frame_id, 'position': {axis: getattr(moved, axis) for axis in 'xyz'},
                     'orientation': {axis: getattr(turned, axis) for axis in 'xyzw'}}
    return found


def save(folder: str, name: str, end: str, content: bytes, description: Mapping[str, Any]) -> str:
    """Write both files, or none; no file is ever there in part, also after a power failure.

    :return: path of the first one
    :raises OSError: they cannot be written
    """
    os.makedirs(folder, exist_ok=True)
    text = yaml.safe_dump({'file': name + end, **description}, sort_keys=False, allow_unicode=True)
    with contextlib.ExitStack() as stack:
        written = [(stack.enter_context(_temporary(folder, data)), os.path.join(folder, name + ending))
                   for ending, data in ((end, content), ('.yaml', text.encode()))]
        for temporary, path in reversed(written):   # who sees the first one finds its description
            os.replace(temporary, path)
    return written[0][1]


@contextlib.contextmanager
def _temporary(folder: str, content: bytes) -> Iterator[str]:
    """A file with this content, which is removed unless it gets another name meanwhile."""
    file = tempfile.NamedTemporaryFile(dir=folder, prefix='.', delete=False)
    try:
        with file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(file.name, 0o644)
        yield file.name
    finally:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(file.name)
