# SPDX-License-Identifier: BSD-3-Clause
"""What of a robot's streams the page shows, and what it may send, from streams.yaml; topics are in the robot's
namespace at this desk."""
from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Tuple

from ..mission.footprint import Footprint
from ..mission.roles import PRIMARY_IMAGE, roles_of
from ..nodes.rviz_displays import CLOUDS, GRIDS, IMAGES, SCANS, Streams, colours_of, kind_of, relative, title
from ..streams.relay.parameters import TO_ROBOT

IMAGE, MAP, CLOUD, POINTS = 'image', 'map', 'cloud', 'points'
"""Kinds of streams."""

NUMBERS = 'std_msgs/Float32', 'std_msgs/Float64'
"""Types of a relay whose values are shown as gas."""


class Entry(NamedTuple):
    """A stream that the page shows."""
    name: str
    number: int
    """In binary frames."""
    kind: str
    topic: str
    """Relative."""
    settings: Mapping[str, Any]
    colour: Optional[str]
    """#rrggbb; None: it has none."""
    primary: bool

    @property
    def annotated(self) -> bool:
        """Whether it is an image stream with a view."""
        return self.settings['type'] == 'image'

    @property
    def captures(self) -> bool:
        """Whether the robot keeps originals of it."""
        return bool(self.settings.get('history'))

    def described(self) -> Dict[str, Any]:
        """As in hello."""
        return {'name': self.name, 'title': title(self.name), 'index': self.number, 'kind': self.kind,
                'colour': self.colour, 'primary': self.primary, 'captures': self.captures,
                'values': self.kind == IMAGE and self.annotated}


class Catalogue:
    """The streams of one robot.

    :param streams: as config.load returns them
    """

    def __init__(self, streams: Streams) -> None:
        colours, roles = colours_of(streams), roles_of(streams)
        self.entries: Dict[str, Entry] = {}
        """By name."""
        self.hidden: List[str] = []
        """Image streams that cannot be shown."""
        for name, settings in streams.items():
            kind = _kind(settings)
            if kind is None:
                continue
            topic = relative(settings['view_topic' if settings['type'] == 'image' else 'operator_topic'])
            if not topic:
                self.hidden.append(name)
                continue
            colour = colours.get(name)
            self.entries[name] = Entry(
                name, len(self.entries), kind, topic, settings,
                '#%02x%02x%02x' % colour if colour and kind in (POINTS, CLOUD) else None,
                roles[name] == PRIMARY_IMAGE)
        self._streams = streams

    def relayed(self, *types: str) -> List[Tuple[str, str]]:
        """(name, relative topic) of the relays from the robot of messages of these types."""
        return [(name, relative(settings['operator_topic'])) for name, settings in self._streams.items()
                if settings.get('message_type') in types and settings.get('direction') != TO_ROBOT
                and settings['type'] == 'relay']

    def sent(self, type_: str, kind: str) -> Optional[str]:
        """The relative topic of the first stream of a kind that sends messages of a type to the robot; None: there is
        none."""
        return next((relative(settings['operator_topic']) for settings in self._streams.values()
                     if settings['type'] == kind and settings.get('message_type') == type_
                     and (kind == 'command' or settings.get('direction') == TO_ROBOT)), None)

    def described(self, name: str, speeds: Tuple[float, float, float], footprint: Footprint) -> Dict[str, Any]:
        """As in hello.

        :param speeds: forward, sideways [m/s], turn [rad/s]
        """
        forward, strafe, turn = speeds
        return {'name': name, 'title': name or 'robot', 'speed': forward, 'turn': turn, 'strafe': strafe,
                'drives': self.sent('geometry_msgs/Twist', 'command') is not None,
                'goals': self.sent('geometry_msgs/PoseStamped', 'relay') is not None,
                'footprint': [list(corner) for corner in footprint],
                'streams': [entry.described() for entry in self.entries.values()]}


def _kind(settings: Mapping[str, Any]) -> Optional[str]:
    """How the page shows a stream; None: it does not."""
    if settings.get('direction') == TO_ROBOT or settings['type'] in ('command', 'service', 'action'):
        return None
    kind = kind_of(settings)
    return next((shown for kinds, shown in ((IMAGES, IMAGE), (GRIDS, MAP), (CLOUDS, CLOUD), (SCANS, POINTS))
                 if kind in kinds), None)
