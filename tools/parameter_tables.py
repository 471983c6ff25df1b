# SPDX-License-Identifier: BSD-3-Clause
"""Writes doc/parameters.md from the tables that the nodes check their parameters with.

    python3 tools/parameter_tables.py           # write it
    python3 tools/parameter_tables.py --check   # exit with 1 where it is out of date
"""
import pathlib
import sys
from typing import Any, List, Mapping

from smokebot_udp.mission.parameters import Parameter
from smokebot_udp.nodes.parameters import NODES
from smokebot_udp.streams import KINDS, TYPES, config, tables
from smokebot_udp.streams.parameters import OPERATOR, ROBOT

PATH = pathlib.Path(__file__).resolve().parent.parent / 'doc' / 'parameters.md'
VALUE_TYPES = {str: 'str', bool: 'bool', int: 'int', float: 'double'}

HEAD = """# Parameters

Generated from the package's parameter tables by `tools/parameter_tables.py`; do not edit.

*live*: the value can be changed while the node runs, by `rosparam set` or dynamic_reconfigure.

"""
STREAMS = """## Streams

These are the settings of a stream in streams.yaml. Live settings of the robot's side are found under
`/robot_sender/<stream>/`, those of the operator's side under `/operator_receiver/<stream>/`. They are requested values;
`/robot_sender/status` shows what the link grants of them. An operator started with `name:=desk2` has its settings under
`/desk2/operator_receiver/<stream>/`. Where the robot has a master of its own (`link_port`), an operator's master shows
the robot's live settings as well, under `/robot_sender/` in the operator's namespace: `/desk2/robot_sender/<stream>/`.

"""


FRAMES = """
## Frames

These stand under `frames:` in streams.yaml, beside `streams:`. `make_streams` proposes them.

"""


def limits(parameter: Parameter) -> str:
    """The values that are allowed, as text; empty where all of the type are."""
    if parameter.choices:
        return ', '.join(choice or "''" for choice in parameter.choices)
    parts = [('> %.7g', parameter.above), ('≥ %.7g', parameter.least), ('≤ %.7g', parameter.most)]
    return ', '.join(text % limit for text, limit in parts if limit is not None)


def row(name: str, parameter: Parameter) -> str:
    """The row of a parameter in a Markdown table."""
    kind = parameter.kind
    default: Any = 'required' if parameter.default is None else parameter.default
    if kind is bool:
        default = str(default).lower()
    elif kind is float:
        default = '%g' % default
    cells = [name, VALUE_TYPES[kind], str(default), parameter.unit, limits(parameter), 'live' if parameter.live else '',
             parameter.meaning]
    return '|' + '|'.join(' %s ' % cell if cell else ' ' for cell in cells) + '|'


def table(parameters: Mapping[str, Parameter]) -> str:
    """A Markdown table of parameters."""
    rows = [row(name, parameter) for name, parameter in parameters.items()]
    return '\n'.join(['| name | type | default | unit | values | | meaning |', '|' + 7 * '---|', *rows, ''])


def page() -> str:
    """The text of doc/parameters.md."""
    parts: List[str] = [HEAD, STREAMS, '### %s\n\n' % ', '.join(sorted(KINDS)), table({**ROBOT, **OPERATOR})]
    for kind in TYPES:
        robot, operator = tables(kind)
        above = {**ROBOT, **OPERATOR} if kind in KINDS else {}
        for side, parameters, listed in (('robot', robot, above), ('operator', operator, {**robot, **above})):
            own = {name: parameter for name, parameter in parameters.items() if listed.get(name) != parameter}
            if own:
                parts += ["\n### %s, %s's side\n\n" % (kind, side), table(own)]
    parts += [FRAMES, table(config.FRAMES)]
    for node, parameters in NODES.items():
        parts += ['\n## /%s\n\n' % node, table({'~' + name: parameter for name, parameter in parameters.items()})]
    return ''.join(parts)


def main(arguments: List[str]) -> int:
    """Write the page, or check it; returns the exit code."""
    text = page()
    if arguments == ['--check']:
        current = PATH.exists() and PATH.read_text() == text
        if not current:
            print('%s is out of date: run tools/parameter_tables.py' % PATH.name, file=sys.stderr)
        return 0 if current else 1
    PATH.write_text(text)
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
