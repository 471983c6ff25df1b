# SPDX-License-Identifier: BSD-3-Clause
"""link.yaml: how a link changes over time, as a list of steps.

    seed: 1
    course:
      - {at: 0, delay: 0.02}                     # both directions
      - {at: 10, loss: 0.3}                      # what is not named stays
      - {at: 20, robot: {rate: 1e6}, operator: {loss: 0.0}}   # what leaves the robot, what leaves the operator
"""
from dataclasses import dataclass, fields, replace

import yaml

from .channel import Quality

SIDES = 'robot', 'operator'
"""A direction is named by the side that sends."""

QUALITIES = tuple(field.name for field in fields(Quality))


@dataclass(frozen=True)
class Step:
    """From a time on, the quality of both directions."""
    at: float      # [s] from the course's beginning
    robot: Quality
    operator: Quality


def load(text):
    """Read the text of a link.yaml.

    :return: (seed, [Step, ...])
    :raises ValueError: with the line and the value that is wrong
    """
    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
        document = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise ValueError('it is no YAML: %s' % ' '.join(str(error).split())) from None
    steps = document.get('course') if isinstance(document, dict) else None
    if not isinstance(steps, list):
        raise ValueError('it has no "course:" with a list of steps')
    lines = next(value.value for key, value in node.value if key.value == 'course')
    before, course = Step(0.0, Quality(), Quality()), []
    for values, where in zip(steps, lines):
        try:
            step = _step(before, values, first=not course)
        except ValueError as error:
            raise ValueError('line %d: %s' % (where.start_mark.line + 1, error)) from None
        course.append(step)
        before = step
    return document.get('seed', 0), course


def _step(before, values, first):
    if not isinstance(values, dict):
        raise ValueError('%r is no step with values' % (values,))
    unknown = sorted(set(map(str, values)) - {'at', *SIDES, *QUALITIES})
    if unknown:
        raise ValueError('%s: no such setting; there are at, %s' % (', '.join(unknown), ', '.join(SIDES + QUALITIES)))
    at = values.get('at')
    if isinstance(at, bool) or not isinstance(at, (int, float)) or not at >= 0:
        raise ValueError('at is %r, must be a time from 0 [s]' % (at,))
    if not first and at <= before.at:
        raise ValueError('at is %g, not after the step before, %g' % (at, before.at))
    both = {name: number(values[name]) for name in QUALITIES if name in values}
    return Step(float(at), **{side: changed(getattr(before, side), {**both, **_of_side(values, side)})
                              for side in SIDES})


def _of_side(values, side):
    own = values.get(side, {})
    if not isinstance(own, dict) or set(own) - set(QUALITIES):
        raise ValueError('%s is %r, must have some of %s' % (side, own, ', '.join(QUALITIES)))
    return {name: number(value) for name, value in own.items()}


def number(value):
    """A number as YAML reads it: it takes 1e6, without a point, for a text."""
    if isinstance(value, str):
        try:
            return float(value)
        except ValueError:
            pass
    return value


def changed(quality, changes):
    """A quality with some values changed; ValueError names the one that is impossible."""
    return replace(quality, **changes)
