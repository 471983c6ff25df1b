# SPDX-License-Identifier: BSD-3-Clause
"""streams.yaml: the streams by name, each checked against its kind's parameters.

A stream that is wrong is left out and told of; the others stand.
"""
import re

import yaml

from ..mission.parameters import Parameter, check
from . import KINDS, operator_class, robot_class

NAME = re.compile(r'[A-Za-z][A-Za-z0-9_]*$')
TYPE = Parameter(None, '', 'the kind of stream', choices=tuple(sorted(KINDS)))


class _Loader(yaml.SafeLoader):
    """YAML that does not pass over a key given twice: the first one stands."""

    def __init__(self, text):
        super().__init__(text)
        self.repeated = []   # (key, line), in the order of the file

    def construct_mapping(self, node, deep=False):
        seen, pairs = set(), []
        for key, value in node.value:
            if key.value in seen:
                self.repeated.append((key.value, key.start_mark.line + 1))
            else:
                seen.add(key.value)
                pairs.append((key, value))
        node.value = pairs
        return super().construct_mapping(node, deep)


def parameters_of(kind):
    """{name: Parameter}: all that streams.yaml may say of a stream of this kind."""
    return {'type': TYPE, **robot_class(kind).PARAMETERS, **operator_class(kind).PARAMETERS}


def load(text):
    """Read the text of a streams.yaml.

    :return: ({name: {setting: value}} of the good streams, [problem, ...] in words)
    """
    loader = _Loader(text)
    try:
        document = loader.get_single_data()
    except yaml.YAMLError as error:
        return {}, ['it is no YAML: %s' % ' '.join(str(error).split())]
    finally:
        loader.dispose()
    problems = ['%r stands twice, again in line %d: the first one counts' % repeated for repeated in loader.repeated]
    streams = document.get('streams') if isinstance(document, dict) else None
    if not isinstance(streams, dict):
        return {}, problems + ['it has no "streams:" with the streams by name']
    good = {}
    for name, values in streams.items():
        try:
            good[name] = _check(name, values)
        except ValueError as error:
            problems.append('stream %r: %s' % (name, error))
    return good, problems


def _check(name, values):
    if not isinstance(name, str) or not NAME.match(name):
        raise ValueError('a name has letters, digits and _, and begins with a letter')
    if not isinstance(values, dict):
        raise ValueError('its settings are %r, not names with values' % (values,))
    kind = values.get('type')
    check({'type': kind}, {'type': TYPE})
    return check(values, parameters_of(kind))
