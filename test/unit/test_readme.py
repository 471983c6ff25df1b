# SPDX-License-Identifier: BSD-3-Clause
"""README.md's tables of parameters say what the code has."""
import pathlib

import pytest

from smokebot_udp.streams import KINDS
from smokebot_udp.streams.config import parameters_of

README = (pathlib.Path(__file__).parents[2] / 'README.md').read_text()
TYPES = {str: 'str', bool: 'bool', int: 'int', float: 'double'}


def row(name, parameter):
    """The line of a table for a parameter."""
    kind = str if parameter.default is None else type(parameter.default)
    default = '' if parameter.default is None else parameter.default
    if kind is bool:
        default = str(default).lower()
    elif kind is float:
        default = '%g' % default
    meaning = parameter.meaning + (': ' + ', '.join(parameter.choices) if parameter.choices else '')
    cells = name, TYPES[kind], default, parameter.unit, meaning + '; dynamic' * parameter.live
    return '|' + '|'.join(' %s ' % cell if cell != '' else ' ' for cell in cells) + '|'


@pytest.mark.parametrize('kind', sorted(KINDS))
def test_every_setting_of_a_stream_is_in_its_table(kind):
    missing = [row(name, parameter) for name, parameter in parameters_of(kind).items()
               if name != 'type' and row(name, parameter) not in README]
    assert not missing, '\n' + '\n'.join(missing)
