# SPDX-License-Identifier: BSD-3-Clause
"""A table of settings as dynamic_reconfigure describes it to its clients."""
from types import SimpleNamespace
from typing import Any, Dict

from ..mission.parameters import Parameter, Table

TYPES = {bool: 'bool', int: 'int', float: 'double', str: 'str'}
LIMITS: Dict[type, Any] = {bool: (False, True), int: (-2 ** 31, 2 ** 31 - 1), float: (-float('inf'), float('inf')),
                           str: ('', '')}


def config_type(name: str, table: Table) -> SimpleNamespace:
    """What dynamic_reconfigure's generator would make of a table {name: Parameter}: a server's `type`."""
    low, high = {}, {}
    for key, parameter in table.items():
        low[key] = LIMITS[parameter.kind][0] if parameter.minimum is None else parameter.kind(parameter.minimum)
        high[key] = LIMITS[parameter.kind][1] if parameter.most is None else parameter.kind(parameter.most)
    described = {'name': 'Default', 'type': '', 'state': True, 'cstate': 'true', 'id': 0, 'parent': 0, 'groups': [],
                 'parameters': [_described(key, parameter) for key, parameter in table.items()]}
    return SimpleNamespace(
        __name__=name, config_description=described, min=low, max=high, all_level=0,
        defaults={key: parameter.default for key, parameter in table.items()}, level={key: 0 for key in table},
        type={key: TYPES[parameter.kind] for key, parameter in table.items()})


def _described(name: str, parameter: Parameter) -> Dict[str, Any]:
    unit = ' [%s]' % parameter.unit if parameter.unit else ''
    constants = [{'name': choice, 'type': 'str', 'value': choice, 'description': '', 'srcline': 0, 'srcfile': '',
                  'cconsttype': 'const char * const', 'ctype': 'std::string'} for choice in parameter.choices]
    return {'name': name, 'type': TYPES[parameter.kind], 'level': 0, 'description': parameter.meaning + unit,
            'edit_method': repr({'enum': constants, 'enum_description': ''}) if constants else ''}
