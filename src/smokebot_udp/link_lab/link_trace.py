# SPDX-License-Identifier: BSD-3-Clause
"""Reads a link trace, link.yaml: a list of steps that define how the conditions of a link change over time.

    seed: 1
    course:
      - {at: 0, delay: 0.02}                     # both directions
      - {at: 10, loss: 0.3}                      # values that are not named stay
      - {at: 20, robot: {rate: 1e6}, operator: {loss: 0.0}}   # one direction, named by the side that sends
"""
from dataclasses import dataclass, fields, replace
from typing import Any, Dict, List, Mapping, Tuple

import yaml

from .channel import LinkConditions

SIDES = 'robot', 'operator'
"""A direction is named by the side that sends."""

CONDITIONS = tuple(field.name for field in fields(LinkConditions))


@dataclass(frozen=True)
class Step:
    """The conditions of both directions from a time on."""
    at: float
    """Time since the start of the trace [s]."""
    robot: LinkConditions
    operator: LinkConditions


def load(text: str) -> Tuple[int, List[Step]]:
    """Read the text of a link.yaml.

    :return: (seed, steps)
    :raises ValueError: with the line and the value that is invalid
    """
    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
        document = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise ValueError('not valid YAML: %s' % ' '.join(str(error).split())) from None
    steps = document.get('course') if isinstance(document, dict) else None
    if not isinstance(steps, list):
        raise ValueError('there is no "course:" with a list of steps')
    lines = next(value.value for key, value in node.value if key.value == 'course')
    before = Step(0.0, LinkConditions(), LinkConditions())
    trace: List[Step] = []
    for values, where in zip(steps, lines):
        try:
            step = _step(before, values, first=not trace)
        except ValueError as error:
            raise ValueError('line %d: %s' % (where.start_mark.line + 1, error)) from None
        trace.append(step)
        before = step
    return document.get('seed', 0), trace


def _step(before: Step, values: Any, first: bool) -> Step:
    if not isinstance(values, dict):
        raise ValueError('%r is not a step with values' % (values,))
    unknown = sorted(set(map(str, values)) - {'at', *SIDES, *CONDITIONS})
    if unknown:
        raise ValueError('%s: no such setting; there are at, %s' % (', '.join(unknown), ', '.join(SIDES + CONDITIONS)))
    at = values.get('at')
    if isinstance(at, bool) or not isinstance(at, (int, float)) or not at >= 0:
        raise ValueError('at is %r, must be a time from 0 [s]' % (at,))
    if not first and at <= before.at:
        raise ValueError('at is %g, not after the step before, %g' % (at, before.at))
    both = {name: number(values[name]) for name in CONDITIONS if name in values}
    robot, operator = (changed(getattr(before, side), {**both, **_of_side(values, side)}) for side in SIDES)
    return Step(float(at), robot, operator)


def _of_side(values: Mapping[str, Any], side: str) -> Dict[str, Any]:
    own = values.get(side, {})
    if not isinstance(own, dict) or set(own) - set(CONDITIONS):
        raise ValueError('%s is %r, must have some of %s' % (side, own, ', '.join(CONDITIONS)))
    return {name: number(value) for name, value in own.items()}


def number(value: Any) -> Any:
    """A number from YAML or the command line; YAML reads 1e6, without a point, as a string. Others are unchanged."""
    if isinstance(value, str):
        try:
            return float(value)
        except ValueError:
            pass
    return value


def changed(conditions: LinkConditions, changes: Mapping[str, Any]) -> LinkConditions:
    """The conditions with some values changed.

    :raises ValueError: naming the value that is invalid
    """
    return replace(conditions, **changes)
