# SPDX-License-Identifier: BSD-3-Clause
"""What holds for the package as a whole: its layers, its Python, its lists."""
import ast
import os
import pathlib
import re
import xml.etree.ElementTree as ElementTree
from typing import Dict, Iterator, List, Set

import pytest

from smokebot_udp.nodes.parameters import ROBOT_SENDER

TOP = pathlib.Path(__file__).resolve().parents[2]
SOURCE = TOP / 'src' / 'smokebot_udp'
MODULES = sorted(SOURCE.rglob('*.py'))
LAYERS = {
    'demo': {'nodes', 'streams', 'codecs', 'monitoring', 'udpros', 'link.keys', 'link_lab', 'simulation'},
    'web': {'nodes', 'streams', 'codecs', 'mission', 'monitoring', 'link.keys', 'teleop', 'udpros', 'limited_log',
            'msg', 'srv'},
    'nodes': {'streams', 'codecs', 'congestion', 'mission', 'monitoring', 'udpros', 'link', 'teleop', 'reliable',
              'capture', 'mission_report.record', 'limited_log', 'msg', 'srv'},
    'streams': {'codecs', 'congestion.operating_points', 'mission.parameters', 'mission.roles', 'mission.settings',
                'mission.yaml_text', 'udpros.frame', 'udpros.datagram', 'msg'},
    'congestion': {'monitoring.stats', 'monitoring.windows'},
    'link_lab': {'udpros', 'msg'},
    'mission_report': {'codecs', 'monitoring.computer', 'streams.config', 'streams.image.source',
                       'streams.recorded_topics'},
    'link': {'udpros.control_messages', 'udpros.datagram', 'udpros.depacketizer', 'udpros.endpoints', 'udpros.frame',
             'udpros.loss_emulation', 'udpros.packetizer', 'udpros.records', 'udpros.sequence'},
    'teleop': {'monitoring.clock_offset', 'monitoring.windows'}, 'reliable': set(),
    'capture': {'codecs', 'reliable.round_trip'},
    'udpros': {'limited_log'}, 'mission': set(), 'monitoring': set(), 'codecs': set(), 'simulation': set(),
}
"""Each package, and the packages and modules below it that it may import."""

EVERYWHERE = {'arrays', 'backoff', 'budget', 'checksum', 'copies', 'frame_names', 'image_error', 'long_messages',
              'newest', 'numpy_messages', 'optional', 'packed', 'paths', 'pauses', 'rotation', 'serialised', 'traffic',
              'transport', 'units', 'version'}
PURE = {'capture', 'codecs', 'congestion', 'mission', 'mission_report', 'monitoring', 'reliable', 'simulation',
        'streams', 'teleop'}
"""Packages without threads, sockets, topics or a clock."""

PURE_UDPROS = {'admission', 'batches', 'bus_info', 'datagram', 'depacketizer', 'frame', 'negotiation', 'packetizer',
               'presence', 'reassembly', 'records', 'sequence', 'silence'}
"""The protocol core of udpros, likewise."""

IMPURE_LINK = {'endpoint', 'interfaces', 'keys', 'peer_topics', 'resolver', 'topics', 'transport'}
"""The other modules of link are its protocol core, likewise."""

IMPURE_WEB = {'browser', 'calls', 'captures', 'desk', 'driving', 'node', 'robot', 'server', 'stills'}
"""The other modules of web decide, likewise."""

IMPURE = {'rospy', 'socket', 'select', 'time', 'rosgraph', 'udpros'}
USES_ROSPY_INTERNALS = {('udpros', 'acceptor'), ('udpros', 'connector'), ('udpros', 'master'),
                        ('udpros', 'registration'), ('udpros', 'rospy_binding'), ('udpros', 'rospy_transports'),
                        ('udpros', 'starting'), ('udpros', 'topics'), ('udpros', 'watch'), ('nodes', 'parameter_watch')}

ENDING = SOURCE / 'udpros' / 'ending.py'
"""The only module that may call rospy.on_shutdown, which forgets what it is given while a node is ended that starts."""

BESIDE = {'evaluation': {'smokebot_udp'}, 'benchmarks': {'smokebot_udp', 'evaluation'},
          'experiments': {'smokebot_udp', 'evaluation'}}
"""What is not installed, and what of this checkout it may import."""


def imports(path: pathlib.Path, top: pathlib.Path, package: str) -> Iterator[str]:
    """Absolute names of what a module imports when it is loaded or run, relative imports resolved."""
    parents = (package, *path.relative_to(top).parent.parts)
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ''
            if node.level:
                above = parents[:len(parents) - node.level + 1]
                base = '.'.join([*above, node.module] if node.module else above)
            yield base
            yield from ('%s.%s' % (base, alias.name) for alias in node.names)


def module_name(path: pathlib.Path) -> str:
    parts = path.relative_to(SOURCE).with_suffix('').parts
    return '.'.join(('smokebot_udp', *(parts[:-1] if parts[-1] == '__init__' else parts)))


@pytest.mark.parametrize('path', MODULES, ids=lambda path: str(path.relative_to(SOURCE)))
def test_a_package_imports_only_what_is_below_it(path: pathlib.Path) -> None:
    package = path.relative_to(SOURCE).parts[0]
    if path.parent == SOURCE:
        return
    allowed = LAYERS[package] | EVERYWHERE | {package}
    for name in imports(path, SOURCE, 'smokebot_udp'):
        if name.startswith('smokebot_udp.'):
            inner = name.split('.', 1)[1]
            above = any(allow.startswith(inner + '.') for allow in allowed)     # the package of an allowed module
            assert above or any(inner == allow or inner.startswith(allow + '.') for allow in allowed), name
        if name.startswith(('rospy.impl', 'rospy.topics', 'rospy.core', 'rospy.msg')):
            assert (package, path.stem) in USES_ROSPY_INTERNALS, name


@pytest.mark.parametrize('path', [path for path in MODULES if path.relative_to(SOURCE).parts[0] in PURE
                                  or (path.parent.name == 'udpros' and path.stem in PURE_UDPROS)
                                  or (path.parent.name == 'link' and path.stem not in IMPURE_LINK)
                                  or (path.parent.name == 'web' and path.stem not in IMPURE_WEB)],
                         ids=lambda path: str(path.relative_to(SOURCE)))
def test_what_decides_has_no_threads_sockets_topics_or_clock(path: pathlib.Path) -> None:
    for name in imports(path, SOURCE, 'smokebot_udp'):
        root = name.split('.')[0]
        assert root not in IMPURE, name


def test_nodes_say_by_on_end_what_they_do_at_their_end() -> None:
    assert [path for path in MODULES if 'on_shutdown(' in path.read_text()] == [ENDING]


def test_no_module_imports_itself_by_way_of_others() -> None:
    names = {module_name(path): path for path in MODULES}
    graph: Dict[str, Set[str]] = {}
    for name, path in names.items():
        found = [other for other in imports(path, SOURCE, 'smokebot_udp') if other in names and other != name]
        # from . import module: the package is named, but nothing of its __init__ is used
        graph[name] = {other for other in found if not any(more.startswith(other + '.') for more in found)}
    done: Set[str] = set()

    def visit(name: str, way: List[str]) -> None:
        assert name not in way, ' -> '.join([*way, name])
        if name not in done:
            for other in sorted(graph[name]):
                visit(other, [*way, name])
            done.add(name)

    for name in sorted(names):
        visit(name, [])


@pytest.mark.parametrize('path', sorted(path for folder in BESIDE for path in (TOP / folder).rglob('*.py')),
                         ids=lambda path: str(path.relative_to(TOP)))
def test_what_is_not_installed_imports_only_what_it_may(path: pathlib.Path) -> None:
    folder = path.relative_to(TOP).parts[0]
    for name in imports(path, TOP / folder, folder):
        root = name.split('.')[0]
        if root in BESIDE:
            assert root in BESIDE[folder] | {folder}, name


@pytest.mark.parametrize('path', MODULES, ids=lambda path: str(path.relative_to(SOURCE)))
def test_the_package_does_not_import_what_is_not_installed(path: pathlib.Path) -> None:
    assert not {name.split('.')[0] for name in imports(path, SOURCE, 'smokebot_udp')} & {*BESIDE, 'test', 'tools'}


@pytest.mark.parametrize('path', MODULES + sorted((TOP / 'scripts').iterdir()), ids=lambda path: path.name)
def test_python_3_8_reads_it(path: pathlib.Path) -> None:
    ast.parse(path.read_text(), feature_version=(3, 8))


@pytest.mark.parametrize('path', MODULES, ids=module_name)
def test_functions_have_60_lines_at_most(path: pathlib.Path) -> None:
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.FunctionDef):
            assert (node.end_lineno or 0) - node.lineno < 60, node.name


def test_every_script_is_installed_and_executable() -> None:
    listed = set(re.findall(r'scripts/(\w+)', (TOP / 'CMakeLists.txt').read_text()))
    assert listed == {path.name for path in (TOP / 'scripts').iterdir()}
    assert all(os.access(str(path), os.X_OK) for path in (TOP / 'scripts').iterdir())


@pytest.mark.parametrize('path', sorted((TOP / 'launch').glob('*.launch')), ids=lambda path: path.name)
def test_no_launch_argument_is_listed_as_required(path: pathlib.Path) -> None:
    """The command `roslaunch --ros-args` lists an argument as required if it has no default, or one without letters."""
    for argument in ElementTree.parse(str(path)).getroot().findall('arg'):
        assert argument.get('default') and argument.get('doc'), argument.get('name')


def test_an_argument_has_one_default_in_all_launch_files() -> None:
    """Whoever leaves it out gets the same from each; but the demo loses datagrams, and its robots are a number."""
    defaults: Dict[str, Set[str]] = {}
    for path in (TOP / 'launch').glob('*.launch'):
        for argument in ElementTree.parse(str(path)).getroot().findall('arg'):
            defaults.setdefault(argument.get('name', ''), set()).add(argument.get('default', ''))
    assert {name for name, found in defaults.items() if len(found) > 1} == {'loss', 'robots'}
    assert defaults['max_rate'] == {'%g' % ROBOT_SENDER['max_rate'].default}


def test_the_demo_takes_what_is_chosen_for_a_robot() -> None:
    for name in 'demo.launch', 'simulated_robot.launch':
        arguments = ElementTree.parse(str(TOP / 'launch' / name)).getroot().findall('arg')
        assert {'max_rate', 'record_streams', 'record_lossless'} <= {argument.get('name') for argument in arguments}


def test_every_integration_test_has_its_launch_file() -> None:
    folder = TOP / 'test' / 'integration'
    wanted = {name for file in folder.glob('*.test') for name in re.findall(r'type="(test_\w+\.py)"', file.read_text())}
    assert wanted == {path.name for path in folder.glob('test_*.py')}


def test_every_message_is_built_and_every_field_explained() -> None:
    listed = set(re.findall(r'(\w+\.msg)', (TOP / 'CMakeLists.txt').read_text()))
    assert listed == {path.name for path in (TOP / 'msg').glob('*.msg')}
    for path in (TOP / 'msg').glob('*.msg'):
        for line in path.read_text().splitlines():
            assert not line.strip() or '#' in line, '%s: %s' % (path.name, line)


ROS_NAMES = {'_type', '_md5sum', '_slot_types', '_has_header', '_full_text', '_connection_header', '_replace',
             '_asdict', '_fields', '_exit', '_TYPE', '_buff', '_marshaled_dispatch', '_XMLTestResult'}
"""Names of ROS, the standard library and named tuples for which there are no others."""


@pytest.mark.parametrize('path', sorted((TOP / 'test').rglob('*.py')) + sorted(
    path for folder in BESIDE for path in (TOP / folder).rglob('*.py')), ids=lambda path: path.name)
def test_tests_and_experiments_use_public_names_only(path: pathlib.Path) -> None:
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Attribute) and node.attr.startswith('_') and not node.attr.startswith('__'):
            own = isinstance(node.value, ast.Name) and node.value.id in ('self', 'cls')
            assert own or node.attr in ROS_NAMES, 'line %d: %s' % (node.lineno, node.attr)
