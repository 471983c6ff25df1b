# SPDX-License-Identifier: BSD-3-Clause
"""streams.yaml: the streams by name, each checked against its kind's parameters.

A stream that is wrong is left out and reported; the others are used. Streams that the package itself needs are added
where the file has none.
"""
import re
from typing import Any, Callable, Container, Dict, List, Mapping, Tuple

import yaml

from ..mission.parameters import LINK_STATUS, ROBOT_STATUS, Parameter, check, current_names
from . import KINDS, assembler_class, encoder_class

NAME = re.compile(r'[A-Za-z][A-Za-z0-9_]*$')
TYPE = Parameter(None, '', 'the kind of stream', choices=tuple(sorted(KINDS)))

OWN_STREAMS: Mapping[str, Mapping[str, Any]] = {
    'link': {'message_type': LINK_STATUS, 'rate': 2.0},
    'status': {'message_type': ROBOT_STATUS, 'latch': True},
}
"""Relays of robot_sender's own topics; added where a file has no stream with their message types."""


class _Loader(yaml.SafeLoader):
    """YAML that reports a key given twice; the first one counts."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self.repeated: List[Tuple[str, int]] = []   # (key, line), in the order of the file

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        seen, pairs = set(), []
        for key, value in node.value:
            if key.value in seen:
                self.repeated.append((key.value, key.start_mark.line + 1))
            else:
                seen.add(key.value)
                pairs.append((key, value))
        node.value = pairs
        return super().construct_mapping(node, deep)


def parameters_of(kind: str) -> Dict[str, Parameter]:
    """{name: Parameter}: all parameters in streams.yaml of a stream of this kind."""
    return {'type': TYPE, **encoder_class(kind).PARAMETERS, **assembler_class(kind).PARAMETERS}


def load(text: str, warn: Callable[[str], None] = lambda warning: None
         ) -> Tuple[Dict[str, Dict[str, Any]], List[str]]:
    """Read the text of a streams.yaml.

    :param warn: called with each warning
    :return: ({name: {setting: value}} of the good streams, [problem, ...] in words)
    """
    loader = _Loader(text)
    try:
        document = loader.get_single_data()
    except yaml.YAMLError as error:
        return {}, ['not valid YAML: %s' % ' '.join(str(error).split())]
    finally:
        loader.dispose()
    problems = ['%r is given twice, again in line %d: the first one counts' % repeated for repeated in loader.repeated]
    streams = document.get('streams') if isinstance(document, dict) else None
    if not isinstance(streams, dict):
        return {}, problems + ['it has no "streams:" with the streams by name']
    good: Dict[str, Dict[str, Any]] = {}
    for name, values in streams.items():
        try:
            settings = _check(name, values, warn)
            _check_topics(settings, good)
            good[name] = settings
        except ValueError as error:
            problems.append('stream %r: %s' % (name, error))
    good.update(_missing_own_streams(good, streams))
    return good, problems


def _missing_own_streams(good: Mapping[str, Mapping[str, Any]], written: Container[Any]) -> Dict[str, Dict[str, Any]]:
    """{name: settings} of those of OWN_STREAMS that no good stream replaces.

    :param written: the names in the file, those of refused streams included
    """
    relayed = {settings.get('message_type') for settings in good.values()}
    topics = {_normalised(settings['operator_topic']).lstrip('/') for settings in good.values()}
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


def _check(name: Any, values: Any, warn: Callable[[str], None]) -> Dict[str, Any]:
    if not isinstance(name, str) or not NAME.match(name):
        raise ValueError('a name has letters, digits and _, and begins with a letter')
    if not isinstance(values, dict):
        raise ValueError('its settings are %r, not names with values' % (values,))
    settings, warnings = current_names(values)
    for warning in warnings:
        warn('stream %r: %s' % (name, warning))
    kind = settings.get('type')
    check({'type': kind}, {'type': TYPE})
    return check(settings, parameters_of(str(kind)))


def _check_topics(settings: Mapping[str, Any], others: Mapping[str, Mapping[str, Any]]) -> None:
    """Check the topics of a stream, and that its source has one type.

    Relative names of the robot's side are compared as they are written: its node resolves them in its namespace. Those
    of the operator's side are all in the namespace of its node.

    :param others: {name: settings} of the streams before it
    :raises ValueError: where they make a loop, the operator's topic is that of another stream, or another stream
        expects messages of another type of its source
    """
    published = _normalised(settings['operator_topic'])
    if published.startswith('/') and published == _normalised(settings['robot_topic']):
        raise ValueError('robot_topic and operator_topic are both %s: the stream would send again and again what it '
                         'publishes itself' % published)
    for name, other in others.items():
        if published.lstrip('/') == _normalised(other['operator_topic']).lstrip('/'):
            raise ValueError("operator_topic %s is already the operator_topic of stream '%s'" % (published, name))
        types = _source_type(settings), _source_type(other)
        if _normalised(settings['robot_topic']) == _normalised(other['robot_topic']) and types[0] != types[1]:
            raise ValueError("robot_topic %s must be %s, but %s for stream '%s'" % (
                settings['robot_topic'], types[0], types[1], name))


def _source_type(settings: Mapping[str, Any]) -> str:
    """The message type of a stream's source, as package/Type."""
    return str(settings.get('message_type') or encoder_class(settings['type']).MESSAGE._type)


def _normalised(topic: str) -> str:
    """The name of a topic without superfluous slashes."""
    return '/' * topic.startswith('/') + '/'.join(part for part in topic.split('/') if part)
