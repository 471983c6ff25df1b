# SPDX-License-Identifier: BSD-3-Clause
"""What a stream may be told in streams.yaml: one table a kind, from which values are checked."""
import math
from dataclasses import dataclass
from typing import Any, Optional, Tuple


@dataclass(frozen=True)
class Parameter:
    """One setting of a stream."""
    default: Any
    """Its type is the parameter's; None: the parameter must be given, as a string that is not empty."""
    unit: str
    meaning: str
    above: Optional[float] = None
    """A number must be greater than this."""
    least: Optional[float] = None
    most: Optional[float] = None
    choices: Tuple[str, ...] = ()
    live: bool = False
    """Whether it may change while the stream runs."""

    def check(self, value):
        """The value in the parameter's type; ValueError says what it should be."""
        kind = str if self.default is None else type(self.default)
        if kind is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
            raise ValueError('must be %s' % self._wanted(kind))
        if kind in (int, float) and not self._within(value):
            raise ValueError('must be %s' % self._wanted(kind))
        if kind is str and ((not value and self.default is None) or (self.choices and value not in self.choices)):
            raise ValueError('must be %s' % self._wanted(kind))
        return value

    def _within(self, value):
        return (math.isfinite(value) and (self.above is None or value > self.above)
                and (self.least is None or value >= self.least) and (self.most is None or value <= self.most))

    def _wanted(self, kind):
        if self.choices:
            return 'one of ' + ', '.join(self.choices)
        limits = [(self.above, 'above %g'), (self.least, 'from %g'), (self.most, 'to %g')]
        words = [{str: 'a text', bool: 'true or false', int: 'a whole number', float: 'a number'}[kind]]
        words += [text % limit for limit, text in limits if limit is not None]
        return ' '.join(words) + (' [%s]' % self.unit if self.unit else '')


def check(values, table):
    """Check a stream's settings against its kind's table.

    :param values: {name: value} as read from YAML
    :param table: {name: Parameter}
    :return: {name: value} with every name of the table
    :raises ValueError: naming the setting and its value
    """
    unknown = sorted(set(map(str, values)) - set(table))
    if unknown:
        raise ValueError('%s: no such setting; there are %s' % (', '.join(unknown), ', '.join(sorted(table))))
    checked = {}
    for name, parameter in table.items():
        if name not in values:
            if parameter.default is None:
                raise ValueError('%s is missing: %s' % (name, parameter.meaning))
            checked[name] = parameter.default
            continue
        checked[name] = check_one(name, values[name], table)
    return checked


def check_one(name, value, table):
    """One value in its parameter's type.

    :raises ValueError: naming the setting and its value
    """
    if name not in table:
        raise ValueError('%s: no such setting; there are %s' % (name, ', '.join(sorted(table))))
    try:
        return table[name].check(value)
    except ValueError as error:
        raise ValueError('%s is %r, %s' % (name, value, error)) from None


def live(table):
    """Of a table {name: Parameter} what may change while the stream runs."""
    return {name: parameter for name, parameter in table.items() if parameter.live}
