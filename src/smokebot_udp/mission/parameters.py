# SPDX-License-Identifier: BSD-3-Clause
"""Parameters: tables define the allowed values of each, and check them."""
import math
from dataclasses import dataclass
from typing import Any, Dict, Mapping, Optional, Tuple, Type

LINK_STATUS, ROBOT_STATUS = STATUS_TYPES = 'smokebot_udp/LinkStatus', 'smokebot_udp/RobotStatus'
"""Message types of this package's own relays: they work in every focus, because the switch of the focus needs them."""

EXCHANGES = frozenset({'action', 'command', 'service'})
"""Types of streams without encoder and assembler: what operators send the robot, and its answers."""

RELIABLE = 'reliable'
"""What a relay with `reliable` is, see `kind_of`: it has neither encoder nor assembler."""

SMALLEST = 1e-6
"""What dialogs offer beyond a limit that is itself not allowed: a micrometre, a microsecond."""

TYPE_NAMES = {str: 'a text', bool: 'true or false', int: 'a whole number', float: 'a number'}


@dataclass(frozen=True)
class Parameter:
    """One parameter."""
    default: Any
    """Its type is the parameter's; None: the parameter is required, a string that is not empty."""
    unit: str
    meaning: str
    above: Optional[float] = None
    """A number must be greater than this."""
    least: Optional[float] = None
    most: Optional[float] = None
    choices: Tuple[str, ...] = ()
    live: bool = False
    """Whether it may change while the node runs."""
    many: bool = False
    """Whether a text may be given as a list of texts, too: it becomes one, with commas."""

    @property
    def kind(self) -> Type[Any]:
        """The type of the parameter's values: str, bool, int or float."""
        return str if self.default is None else type(self.default)

    @property
    def minimum(self) -> Optional[float]:
        """The smallest number that dialogs offer: it is allowed; None: there is no limit."""
        return self.least if self.above is None else self.above + SMALLEST

    def check(self, value: Any) -> Any:
        """The value in the parameter's type; whole numbers are numbers, too.

        :raises ValueError: that says what it must be
        """
        if self.kind is float and type(value) is int and abs(value) < 2 ** 53:
            value = float(value)
        if self.many and isinstance(value, list) and all(isinstance(item, str) for item in value):
            value = ', '.join(value)
        if type(value) is not self.kind or not self._allows(value):
            raise ValueError('must be ' + self.allowed)
        return value

    def _allows(self, value: Any) -> bool:
        """Whether a value of the right type is among the choices, or within the limits."""
        if self.choices:
            return value in self.choices
        if self.kind is str:
            return bool(value) or self.default is not None
        return (-math.inf < value < math.inf and (self.above is None or value > self.above)
                and (self.least is None or value >= self.least) and (self.most is None or value <= self.most))

    @property
    def allowed(self) -> str:
        """The allowed values, in words."""
        if self.choices:
            return 'one of ' + ', '.join(choice or "''" for choice in self.choices)
        limits = [(self.above, 'above %g'), (self.least, 'from %g'), (self.most, 'to %g')]
        words = [TYPE_NAMES[self.kind]] + [text % limit for limit, text in limits if limit is not None]
        return ' '.join(words) + (' [%s]' % self.unit if self.unit else '')


Table = Mapping[str, Parameter]
"""{name: Parameter}"""


def check(values: Mapping[str, Any], table: Table) -> Dict[str, Any]:
    """Check values against a table.

    :param values: {name: value} as read from YAML
    :return: {name: value} with every name of the table
    :raises ValueError: naming the parameter and its value
    """
    unknown = sorted(set(map(str, values)) - set(table))
    if unknown:
        raise _unknown(', '.join(unknown), table)
    missing = [name for name, parameter in table.items() if parameter.default is None and name not in values]
    if missing:
        raise ValueError('%s is missing: %s' % (missing[0], table[missing[0]].meaning))
    return {name: check_one(name, values[name], table) if name in values else parameter.default
            for name, parameter in table.items()}


def check_one(name: str, value: Any, table: Table) -> Any:
    """One value in its parameter's type.

    :raises ValueError: naming the parameter and its value
    """
    if name not in table:
        raise _unknown(name, table)
    try:
        return table[name].check(value)
    except ValueError as error:
        raise ValueError('%s is %r, %s' % (name, value, error)) from None


def _unknown(name: str, table: Table) -> ValueError:
    return ValueError('%s: no such setting; there are %s' % (name, ', '.join(sorted(table))))


def live(table: Table) -> Dict[str, Parameter]:
    """The part of a table that may change while the node runs."""
    return {name: parameter for name, parameter in table.items() if parameter.live}


def kind_of(settings: Mapping[str, Any]) -> str:
    """What a stream is: RELIABLE, for a relay that is acknowledged and repeated, or its type.

    :param settings: of the stream, as streams.yaml has them
    """
    kind = str(settings.get('type'))
    acknowledged = settings.get('reliable') or settings.get('direction') == 'to_robot'
    return RELIABLE if kind == 'relay' and acknowledged else kind


def works_in_every_focus(settings: Mapping[str, Any]) -> bool:
    """Whether `others` of a focus's profile does not apply to a stream: only a profile that names it changes it.

    True of the relays that the switch of the focus needs, and of all that operators send the robot.
    """
    return settings.get('message_type') in STATUS_TYPES or kind_of(settings) in {*EXCHANGES, RELIABLE}
