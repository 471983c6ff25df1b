# SPDX-License-Identifier: BSD-3-Clause
"""What holds for the package as a whole: its rooms' order, its Python, its lists."""
import ast
import os
import pathlib
import re

import pytest

TOP = pathlib.Path(__file__).resolve().parents[2]
SOURCE = TOP / 'src' / 'smokebot_udp'
MODULES = sorted(SOURCE.rglob('*.py'))
MAY_IMPORT = {
    'nodes': {'nodes', 'streams', 'codecs', 'udpros', 'congestion', 'mission', 'monitoring', 'simulation', 'msg',
              'srv'},
    'streams': {'streams', 'codecs', 'udpros', 'congestion', 'mission', 'msg'},
    'codecs': {'codecs'}, 'udpros': {'udpros'}, 'simulation': {'simulation'},
    'congestion': {'congestion'}, 'mission': {'mission'}, 'monitoring': {'monitoring'},
    'link_lab': {'link_lab', 'streams', 'congestion', 'udpros', 'codecs', 'msg'},
}
"""Each room of the package, and the rooms it may know."""

KNOW_ROSPY_INSIDE = {('udpros', 'registration'), ('udpros', 'rospy_binding'), ('udpros', 'rospy_transports'),
                     ('udpros', 'topics'), ('nodes', 'live')}

PURE = {'datagram', 'frame', 'negotiation', 'pacer', 'reassembly', 'records', 'sequence'}
"""udpros' protocol core: without sockets, rospy or a clock."""


def imports(path):
    """Absolute names of what a module imports, relative imports resolved."""
    package = ('smokebot_udp',) + path.relative_to(SOURCE).parent.parts
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield node.module
            yield from ('%s.%s' % (node.module, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = '.'.join(package[:len(package) - node.level + 1] + ((node.module,) if node.module else ()))
            yield from [base] if node.module else ('%s.%s' % (base, alias.name) for alias in node.names)


@pytest.mark.parametrize('path', MODULES, ids=lambda path: str(path.relative_to(SOURCE)))
def test_a_room_knows_only_those_below_it(path):
    room = path.relative_to(SOURCE).parts[0]
    if room in ('__init__.py', 'arrays.py'):
        return
    for name in imports(path):
        parts = name.split('.')
        if parts[0] == 'smokebot_udp' and len(parts) > 1:
            assert parts[1] in MAY_IMPORT[room] | {'arrays'}, name
        if room in ('codecs', 'simulation', 'congestion', 'mission', 'monitoring'):
            assert parts[0] not in ('rospy', 'socket', 'rosgraph', 'sensor_msgs'), name
        if room in ('congestion', 'mission', 'monitoring'):
            assert parts[0] != 'time', name
        if room == 'udpros' and path.stem in PURE:
            assert parts[0] not in ('rospy', 'socket', 'time', 'rosgraph', 'select'), name
        if name.startswith(('rospy.impl', 'rospy.topics', 'rospy.core', 'rospy.msg')):
            assert (room, path.stem) in KNOW_ROSPY_INSIDE, name


@pytest.mark.parametrize('path', MODULES + sorted((TOP / 'scripts').iterdir()), ids=lambda path: path.name)
def test_python_3_8_reads_it(path):
    ast.parse(path.read_text(), feature_version=(3, 8))


def test_every_script_is_installed_and_executable():
    listed = set(re.findall(r'scripts/(\w+)', (TOP / 'CMakeLists.txt').read_text()))
    assert listed == {path.name for path in (TOP / 'scripts').iterdir()}
    assert all(os.access(str(path), os.X_OK) for path in (TOP / 'scripts').iterdir())


def test_every_integration_test_has_its_launch_file():
    folder = TOP / 'test' / 'integration'
    wanted = {name for file in folder.glob('*.test') for name in re.findall(r'type="(test_\w+\.py)"', file.read_text())}
    assert wanted == {path.name for path in folder.glob('test_*.py')}


def test_every_message_is_built_and_every_field_explained():
    listed = set(re.findall(r'(\w+\.msg)', (TOP / 'CMakeLists.txt').read_text()))
    assert listed == {path.name for path in (TOP / 'msg').glob('*.msg')}
    for path in (TOP / 'msg').glob('*.msg'):
        for line in path.read_text().splitlines():
            assert not line.strip() or '#' in line, '%s: %s' % (path.name, line)
