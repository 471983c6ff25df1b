# SPDX-License-Identifier: BSD-3-Clause
"""Reads streams.yaml: the streams by name, each checked against its kind's parameters; and the robot's frames.

A stream that is wrong is left out and reported; the others are used. Streams that the package itself needs are added
where the file has none.
"""
import re
from typing import Any, Callable, Container, Dict, List, Mapping, NamedTuple, Tuple

from ..frame_names import BASE_FRAME, FIXED_FRAME, is_legal
from ..mission.parameters import EXCHANGES, LINK_STATUS, RELIABLE, ROBOT_STATUS, Parameter, check, kind_of
from ..mission.yaml_text import read_yaml
from . import TYPES, parameters_module, tables
from .routes import Routes, check_routes, routes_of

NAME = re.compile(r'[A-Za-z][A-Za-z0-9_]*$')
TYPE = Parameter(None, '', 'the kind of stream', choices=TYPES)

FRAMES: Mapping[str, Parameter] = {
    'fixed': Parameter(FIXED_FRAME, '', 'frame in which the world stands still: the fixed frame of rviz'),
    'base': Parameter(BASE_FRAME, '', 'frame of the robot itself: rviz follows it; default of base_frame, robot_frame'),
}
"""In streams.yaml under "frames:"."""

BASE_FRAMES = 'base_frame', 'robot_frame'
"""Settings of streams whose default is the base."""

VIEWS = 'cloud', 'image', 'scan', 'virtual_scan'
"""Types that require_fresh may name: a map, or a message that is relayed, gets old where nothing changes."""

VIEW = '/view'
"""Appended to the operator's topic of an image: that of its view."""

OWN_STREAMS: Mapping[str, Mapping[str, Any]] = {
    'link': {'message_type': LINK_STATUS, 'rate': 2.0},
    'status': {'message_type': ROBOT_STATUS, 'latch': True},
}
"""Relays of robot_sender's own topics; added where a file has no stream with their message types."""


class Frames(NamedTuple):
    """Frames of the robot, without a prefix."""
    fixed: str = FIXED_FRAME
    base: str = BASE_FRAME


class Streams(Dict[str, Dict[str, Any]]):
    """{name: {setting: value}} of the good streams."""
    frames = Frames()


def parameters_of(kind: str) -> Dict[str, Parameter]:
    """{name: Parameter}: all parameters in streams.yaml of a stream of this kind."""
    robot, operator = tables(kind)
    return {'type': TYPE, **robot, **operator}


def load(text: str, warn: Callable[[str], None] = lambda warning: None,
         refuse: Callable[[str, str], None] = lambda name, why: None) -> Tuple[Streams, List[str]]:
    """Read the text of a streams.yaml.

    :param warn: called with each warning
    :param refuse: f(name, why), called with each stream that is left out; problems have it, too
    :return: (the good streams, [problem, ...] in words)
    """
    document, problems = read_yaml(text)
    if document is None and problems:
        return Streams(), problems
    streams = document.get('streams') if isinstance(document, dict) else None
    if not isinstance(streams, dict):
        return Streams(), problems + ['it has no "streams:" with the streams by name']
    good = Streams()
    try:
        good.frames = _frames(document.get('frames', {}))
    except ValueError as error:
        problems.append('frames: %s' % error)
    routes: Dict[str, Routes] = {}
    for name, values in streams.items():
        try:
            settings = _check(name, values, good.frames.base, warn)
            found = routes_of(settings)
            check_routes(found, routes)
            good[name], routes[name] = settings, found
        except ValueError as error:
            problems.append('stream %r: %s' % (name, error))
            refuse(str(name), str(error))
    for name in [name for name, settings in good.items() if settings['type'] == 'command']:
        try:
            _check_view(good[name]['require_fresh'], good)
        except ValueError as error:
            problems.append('stream %r: %s' % (name, error))
            refuse(name, str(error))
            del good[name], routes[name]
    good.update(_missing_own_streams(good, routes, streams))
    return good, problems


def _missing_own_streams(good: Mapping[str, Mapping[str, Any]], routes: Mapping[str, Routes], written: Container[Any]
                         ) -> Dict[str, Dict[str, Any]]:
    """{name: settings} of those of OWN_STREAMS that no good stream replaces.

    :param routes: of the good streams
    :param written: the names in the file, those of refused streams included
    """
    relayed = {settings.get('message_type') for settings in good.values()}
    topics = {route.operator.lstrip('/') for found in routes.values() for route in found}
    missing = {}
    for topic, settings in OWN_STREAMS.items():
        if settings['message_type'] in relayed:
            continue
        name = topic
        while name in written or 'operator/' + name in topics:
            name = 'robot_' + name
        missing[name] = check({'type': 'relay', 'robot_topic': '~' + topic, 'operator_topic': 'operator/' + name,
                               **settings}, parameters_of('relay'))
    return missing


def _frames(values: Any) -> Frames:
    if not isinstance(values, dict):
        raise ValueError('they are %r, not names with values' % (values,))
    frames = Frames(**check(values, FRAMES))
    for name, frame in zip(frames._fields, frames):
        if not is_legal(frame):
            raise ValueError('%s is %r, must be letters, digits, _, ., - and /, beginning with a letter or _, at most '
                             '100' % (name, frame))
    return frames


def _check(name: Any, values: Any, base: str, warn: Callable[[str], None]) -> Dict[str, Any]:
    if not isinstance(name, str) or not NAME.match(name):
        raise ValueError('a name has letters, digits and _, and begins with a letter')
    if not isinstance(values, dict):
        raise ValueError('its settings are %r, not names with values' % (values,))
    kind = values.get('type')
    check({'type': kind}, {'type': TYPE})
    table = parameters_of(str(kind))
    checked = check({**{setting: base for setting in BASE_FRAMES if setting in table}, **values}, table)
    if kind == 'image':
        checked['view_topic'] = {'': checked['operator_topic'] + VIEW, 'none': ''}.get(
            checked['view_topic'], checked['view_topic'])
    kind = kind_of(checked)
    if kind in {*EXCHANGES, 'relay', RELIABLE}:
        parameters_module(kind).check(checked)
    if kind == RELIABLE:
        for setting in sorted(parameters_module(kind).UNUSED & set(values)):
            warn('stream %r: %s is not used: a reliable relay sends every message' % (name, setting))
    return checked


def _check_view(view: str, streams: Mapping[str, Mapping[str, Any]]) -> None:
    """Check a command stream's require_fresh.

    :raises ValueError: where there is no such stream, or its age says nothing about the link
    """
    if view and streams.get(view, {}).get('type') not in VIEWS:
        raise ValueError('require_fresh is %r, must be the name of a stream of type %s' % (view, ', '.join(VIEWS)))
