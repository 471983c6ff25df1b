# SPDX-License-Identifier: BSD-3-Clause
"""Files of originals: what is read is what the message holds."""
import os
import pathlib
import subprocess
import sys
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from genpy import Time
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import Image, PointCloud2, PointField

from smokebot_udp.capture.files import described, file_name, file_of, pcd, save
from smokebot_udp.codecs.wire.pixels import ENCODINGS, as_pixels


def image(encoding: str, bigendian: bool = False) -> Any:
    kind, channels = ENCODINGS[encoding]
    step = 7 * channels * np.dtype(kind).itemsize + 3
    values = np.random.RandomState(1).randint(0, 255, 5 * step).astype(np.uint8)
    return Image(height=5, width=7, encoding=encoding, step=step, is_bigendian=bigendian, data=values.tobytes())


@pytest.mark.parametrize('bigendian', [False, True])
@pytest.mark.parametrize('encoding', sorted(ENCODINGS))
def test_images_are_read_as_they_were(encoding: str, bigendian: bool) -> None:
    message = image(encoding, bigendian)
    end, content = file_of(message)
    assert end == ('.tiff' if encoding == '32FC1' else '.png')
    found = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    if encoding.startswith('rgb'):
        found = found[..., [2, 1, 0, 3][:found.shape[2]]]
    wanted = as_pixels(message.data, 5, 7, message.step, encoding, bigendian)
    assert found.dtype.itemsize == wanted.dtype.itemsize
    np.testing.assert_array_equal(found, wanted)


def test_the_level_of_a_png_is_not_that_of_this_opencv(monkeypatch: Any) -> None:
    """Its default is 1 or 3, by the version; with Huffman codes only no level matters."""
    encode, options = cv2.imencode, []
    monkeypatch.setattr(cv2, 'imencode', lambda *arguments: options.extend(arguments[2:]) or encode(*arguments))
    file_of(image('mono16'))
    assert list(*options) == [cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY]


def test_what_opencv_cannot_write_is_refused() -> None:
    message = Image(height=2, width=2, encoding='yuv422', step=4, data=bytes(8))
    with pytest.raises(ValueError, match='cannot write an image yuv422 as .png'):
        file_of(message)


def cloud() -> Any:
    fields = [PointField('intensity', 16, PointField.UINT8, 1), PointField('x', 0, PointField.FLOAT32, 1),
              PointField('y', 4, PointField.FLOAT32, 1), PointField('z', 8, PointField.FLOAT32, 1),
              PointField('normal', 20, PointField.FLOAT64, 3)]
    data = bytes(range(2 * 2 * 48 + 2 * 5))
    return PointCloud2(height=2, width=2, fields=fields, point_step=48, row_step=101, data=data)


def test_a_cloud_has_its_fields_and_its_padding() -> None:
    message = cloud()
    head, data = pcd(message).split(b'DATA binary\n')
    lines = dict(line.split(' ', 1) for line in head.decode().splitlines() if not line.startswith('#'))
    assert lines == {'VERSION': '0.7', 'FIELDS': 'x y z _ intensity _ normal _', 'SIZE': '4 4 4 1 1 1 8 1',
                     'TYPE': 'F F F U U U F U', 'COUNT': '1 1 1 4 1 3 3 4', 'WIDTH': '2', 'HEIGHT': '2',
                     'VIEWPOINT': '0 0 0 1 0 0 0', 'POINTS': '4'}
    assert data == message.data[:96] + message.data[101:197]


def test_clouds_that_are_no_files_are_refused() -> None:
    for change, reason in (({'is_bigendian': True}, 'big-endian'), ({'point_step': 40}, 'point_step'),
                           ({'height': 3}, 'row_step')):
        message = cloud()
        for field, value in change.items():
            setattr(message, field, value)
        with pytest.raises(ValueError, match=reason):
            pcd(message)
    message = cloud()
    message.fields[0].offset = 3
    with pytest.raises(ValueError, match='overlaps'):
        pcd(message)
    message.fields[0].datatype = 99
    with pytest.raises(ValueError, match='type of its field'):
        pcd(message)


def test_names_stay_in_their_folder() -> None:
    assert file_name('/ugv1/', 'thermal', '12.000000034') == '_ugv1__thermal_12.000000034'
    assert file_name('', '../../etc', 'x') == '.._.._etc_x'


def test_the_description_is_beside_the_file(tmp_path: pathlib.Path) -> None:
    message, pose = image('mono16'), TransformStamped()
    message.header.stamp, message.header.frame_id = Time(12, 34), 'thermal'
    pose.header.frame_id, pose.transform.translation.x, pose.transform.rotation.w = 'map', 1.5, 1.0
    folder = str(tmp_path / 'captures')
    path = save(folder, 'thermal_12', '.png', b'png', described(message, pose, {'stream': 'thermal'}))
    assert pathlib.Path(path).read_bytes() == b'png'
    assert sorted(os.listdir(folder)) == ['thermal_12.png', 'thermal_12.yaml']
    assert yaml.safe_load((tmp_path / 'captures' / 'thermal_12.yaml').read_text()) == {
        'file': 'thermal_12.png', 'stream': 'thermal', 'stamp': {'secs': 12, 'nsecs': 34}, 'frame_id': 'thermal',
        'type': 'sensor_msgs/Image', 'width': 7, 'height': 5, 'encoding': 'mono16',
        'pose': {'frame_id': 'map', 'position': {'x': 1.5, 'y': 0.0, 'z': 0.0},
                 'orientation': {'x': 0.0, 'y': 0.0, 'z': 0.0, 'w': 1.0}}}
    assert described(message, None, {})['pose'] == 'unknown'
    with pytest.raises(OSError):
        save(path, 'thermal', '.png', b'', {})      # a file is no folder


def test_on_a_full_disk_there_is_neither_file(tmp_path: pathlib.Path) -> None:
    """Files may have 100 kB here: what is longer fails as on a full disk, after a part of it was written."""
    program = '''
import resource, signal, sys
from smokebot_udp.capture.files import save
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (100000, 100000))
save(sys.argv[1], 'good', '.png', bytes(1000), {})
for content, description in ((bytes(200000), {}), (bytes(1000), {'long': 'x' * 200000})):
    try:
        save(sys.argv[1], 'bad', '.png', content, description)
    except OSError as error:
        print(error.strerror)
'''
    said = subprocess.run([sys.executable, '-c', program, str(tmp_path)], stdout=subprocess.PIPE, check=True)
    assert said.stdout == b'File too large\n' * 2
    assert sorted(os.listdir(tmp_path)) == ['good.png', 'good.yaml']
