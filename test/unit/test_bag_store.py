# SPDX-License-Identifier: BSD-3-Clause
"""The folder of the black box's bags: its limits, and what is wrong with it."""
import os
import pathlib
from typing import Dict, List

import pytest

from smokebot_udp.nodes.bag_store import MB, BagStore

BAGS = ['black_box_robot_2026-11-24-00-05-5%d_%d.bag' % (number, number) for number in range(4)]
OTHERS = ['black_box_robot_notes.bag', 'black_box_robot_ugv1_2026-11-24-00-05-50_0.bag', 'mission.bag',
          'black_box_operator_2026-11-24-00-05-50_0.bag', 'black_box_robot_2026-11-24-00-05-50_0.bag.txt']


def fill(folder: pathlib.Path, sizes: Dict[str, int]) -> None:
    """Files of these sizes, in the order of their age."""
    for number, (name, size) in enumerate(sizes.items()):
        (folder / name).write_bytes(bytes(size))
        os.utime(str(folder / name), (number, number))


def names(folder: pathlib.Path) -> List[str]:
    return sorted(path.name for path in folder.iterdir())


def store(folder: pathlib.Path, limit: int = 1 << 40, free: int = 1 << 40) -> BagStore:
    return BagStore(folder, 'black_box_robot', limit, 10 * MB, lambda _: free)


def test_the_oldest_bags_go_and_other_files_stay(tmp_path: pathlib.Path) -> None:
    fill(tmp_path, {**dict.fromkeys(OTHERS, 1000), **dict.fromkeys(BAGS, 100)})
    assert store(tmp_path, limit=250).prune() == BAGS[:2]
    assert names(tmp_path) == sorted(OTHERS + BAGS[2:])
    assert store(tmp_path, limit=250).prune() == []


def test_the_newest_bag_stays_however_large(tmp_path: pathlib.Path) -> None:
    fill(tmp_path, {BAGS[0]: 1, BAGS[1] + '.active': 1000})
    assert store(tmp_path, limit=10).prune() == [BAGS[0]]
    assert names(tmp_path) == [BAGS[1] + '.active']


def test_a_bag_that_was_never_closed_is_old_too(tmp_path: pathlib.Path) -> None:
    fill(tmp_path, {BAGS[0] + '.active': 100, BAGS[1]: 100})
    assert store(tmp_path, limit=150).prune() == [BAGS[0] + '.active']


def test_old_bags_make_room_on_a_full_disk(tmp_path: pathlib.Path) -> None:
    fill(tmp_path, dict.fromkeys(BAGS, 4 * MB))

    def free(folder: pathlib.Path) -> int:
        return 20 * MB - sum(path.stat().st_size for path in folder.iterdir())
    assert BagStore(tmp_path, 'black_box_robot', 1 << 40, 10 * MB, free).prune() == BAGS[:2]


def test_the_folder_is_made(tmp_path: pathlib.Path) -> None:
    assert store(tmp_path / 'a' / 'b').problem() == '' and (tmp_path / 'a' / 'b').is_dir()


def test_a_full_disk(tmp_path: pathlib.Path) -> None:
    assert store(tmp_path, free=10 * MB).problem() == ''
    assert store(tmp_path, free=10 * MB - 1).problem() == (
        'the disk of %s is full: 9 MB are free, 10 MB are left to others' % tmp_path)


def test_a_file_in_the_place_of_the_folder(tmp_path: pathlib.Path) -> None:
    (tmp_path / 'file').write_text('')
    assert store(tmp_path / 'file').problem() == '%s cannot be used: File exists' % (tmp_path / 'file')
    assert store(tmp_path / 'file' / 'below').problem() == (
        '%s cannot be used: Not a directory' % (tmp_path / 'file' / 'below'))
    assert store(tmp_path / 'file').prune() == []


@pytest.mark.skipif(os.geteuid() == 0, reason='root may write everywhere')
def test_no_right_to_write(tmp_path: pathlib.Path) -> None:
    tmp_path.chmod(0o500)
    assert store(tmp_path).problem() == '%s cannot be used: no right to write there' % tmp_path
