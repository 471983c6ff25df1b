# SPDX-License-Identifier: BSD-3-Clause
"""Imports that may fail in any way."""
import importlib
import pathlib
import subprocess
import sys
from typing import Any, Iterator, List

import numpy as np
import pytest
import rospy

from smokebot_udp import optional
from smokebot_udp.nodes import robot_sender

SOURCE = pathlib.Path(__file__).resolve().parents[2] / 'src'


@pytest.fixture
def folder(tmp_path: pathlib.Path, monkeypatch: Any) -> Iterator[pathlib.Path]:
    """Where modules are found first."""
    monkeypatch.syspath_prepend(str(tmp_path))
    yield tmp_path
    for function in (optional.attempt, optional.found):
        function.cache_clear()
    for name in ('absent_one', 'broken_one'):
        sys.modules.pop(name, None)


@pytest.mark.parametrize('line, problem', [
    ('raise ValueError("numpy.dtype size changed\\nmay be")', 'ValueError: numpy.dtype size changed'),
    ('import sys; sys.nothing', "AttributeError: module 'sys' has no attribute 'nothing'"),
    ('raise ImportError("libpcl.so.1.13: cannot open")', 'ImportError: libpcl.so.1.13: cannot open'),
    ('import absent_one', "ModuleNotFoundError: No module named 'absent_one'"),
    ('raise OSError(5, "no")', 'OSError: [Errno 5] no'), ('raise RuntimeError', 'RuntimeError'), ('(', 'SyntaxError')])
def test_whatever_an_import_raises_counts_as_missing(folder: pathlib.Path, line: str, problem: str) -> None:
    (folder / 'broken_one.py').write_text(line + '\n')
    importlib.invalidate_caches()
    module, said = optional.attempt('broken_one')
    assert module is None and said.startswith('broken_one cannot be imported (%s' % problem) and '\n' not in said
    assert optional.found('broken_one')


def test_what_is_not_installed(folder: pathlib.Path) -> None:
    assert optional.attempt('absent_one') == (None, 'absent_one is not installed')
    assert optional.attempt('absent_one.part').problem == 'absent_one is not installed'
    assert not optional.found('absent_one')


def test_a_module_of_ours_is_missing_where_what_it_imports_is(folder: pathlib.Path) -> None:
    (folder / 'broken_one.py').write_text('from absent_one.part import Thing\n')
    importlib.invalidate_caches()
    assert optional.attempt('broken_one', 'absent_one') == (None, 'absent_one is not installed')


def test_what_is_there_and_what_hides(folder: pathlib.Path, monkeypatch: Any) -> None:
    assert optional.attempt('json') == (importlib.import_module('json'), '') and optional.found('json')
    monkeypatch.setitem(sys.modules, 'absent_one', None)
    assert not optional.found('absent_one') and optional.attempt('absent_one').problem == 'absent_one is not installed'


def test_a_cloud_is_filtered_where_pcl_raises_what_it_raises_beside_another_numpy(folder: pathlib.Path) -> None:
    (folder / 'pcl.py').write_text('raise ValueError("numpy.dtype size changed")\n')
    program = ('import sys; sys.path[:0] = %r; import numpy as np; from smokebot_udp.codecs.perception import voxel; '
               'print(voxel.pcl, voxel.voxel_filter(np.ones((3, 3), np.float32), 0.5)[0].tolist())')
    done = subprocess.run([sys.executable, '-c', program % [str(folder), str(SOURCE)]], stdout=subprocess.PIPE,
                          check=True)
    assert done.stdout.decode().strip() == 'None [[1.0, 1.0, 1.0]]'


@pytest.mark.parametrize('module, said', [(np, []), (None, ['pcl is not installed: clouds are filtered by loops that '
                                                            'numba compiles, or by numpy where it is missing'])])
def test_a_robot_says_once_what_filters_clouds(monkeypatch: Any, module: Any, said: List[str]) -> None:
    logged: List[str] = []
    monkeypatch.setitem(sys.modules, 'pcl', module)
    monkeypatch.setattr(rospy, 'loginfo', lambda form, *values: logged.append(form % values))
    for function in (optional.attempt, robot_sender.tell_of_pcl):
        function.cache_clear()
    for _ in range(2):
        robot_sender.tell_of_pcl()
    assert logged == said
    for function in (optional.attempt, robot_sender.tell_of_pcl):
        function.cache_clear()
