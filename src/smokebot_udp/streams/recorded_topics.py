# SPDX-License-Identifier: BSD-3-Clause
"""Which topics of a side the black box records: those of its streams, and those of the package's own nodes.

On the robot these are the original messages, on the operator's side what came out of the link. Views are left out: they
are drawn from the images, which are recorded. So are masks, and all topics on the wire.
"""
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Sequence

from .routes import routes_of

OWN_TOPICS: Mapping[str, Sequence[str]] = {
    'robot': ('~link', '~status', '~estop', '~focus/modified', '/tf', '/tf_static'),
    'operator': ('~clock_offset', '/operator/control', '/operator/estop', '/operator/estop_release',
                 '/operator/stale'),
}
"""{side: topics besides those of the streams}; ~ is the node robot_sender or operator_receiver."""


class RecordedStream(NamedTuple):
    """What one side records of a stream."""
    type: str
    """Type of the stream, as in streams.yaml: image, grid, relay, ..."""
    to_robot: bool
    """Whether its messages go to the robot; those of an action go both ways."""
    topics: List[str]
    """Names of its topics, resolved."""


def recorded_streams(definitions: Mapping[str, Mapping[str, Any]], side: str, resolve: Callable[[str], str]
                     ) -> Dict[str, RecordedStream]:
    """What a side records of its streams, by their names. Services have no topics, and are left out.

    :param definitions: {name: settings}, as config.load returns them
    :param side: robot or operator
    :param resolve: f(topic as in streams.yaml) -> its full name
    """
    found = {}
    for name, settings in definitions.items():
        routes = [route for route in routes_of(settings) if route.setting != 'service']
        if routes:
            found[name] = RecordedStream(settings['type'], all(route.to_robot for route in routes),
                                         [resolve(route.name(side)) for route in routes])
    return found


def all_topics(streams: Mapping[str, RecordedStream], side: str, resolve: Callable[[str], str]) -> List[str]:
    """All topics that a side records, each once.

    :param streams: of recorded_streams
    """
    own = [resolve(topic) for topic in OWN_TOPICS[side]]
    return sorted({*own, *(topic for stream in streams.values() for topic in stream.topics)})
