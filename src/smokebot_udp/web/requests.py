# SPDX-License-Identifier: BSD-3-Clause
"""What a browser asks for: messages in JSON, checked. doc/web_protocol.md has their meanings."""
import json
import math
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Optional, Tuple

MAX_SIZE = 4096
"""Longer messages end the connection [byte]."""

MAX_ID = 2 ** 31 - 1
MAX_NAME = 100
"""Length of the name of a stream, a robot, a focus [letters]."""

MAX_IMAGES, MAX_POINTS = 8, 8
"""Streams that a browser shows at once."""

MAX_LEVEL, FARTHEST = 6, 1e6
"""Level of a map's tiles; coordinates [m]."""

DEFAULT_RATE, MAX_RATE = 10.0, 30.0
"""Rates of images [Hz]."""

MAX_WIDTH = 8192
"""[pixel]"""


class BadRequest(Exception):
    """A message is wrong, in words.

    :param id: of the message; None: it has none
    """

    def __init__(self, text: str, id: Optional[int] = None) -> None:
        super().__init__(text)
        self.id = id


class WantedImage(NamedTuple):
    """An image stream that a browser shows."""
    width: int
    """[pixel]"""
    rate: float
    """Maximum [Hz]."""


class WantedMap(NamedTuple):
    """A part of a map that a browser shows."""
    stream: str
    level: int
    area: Tuple[float, float, float, float]
    """x0, y0, x1, y1, in order [m]."""


class Watch(NamedTuple):
    """What a browser shows."""
    robot: Optional[str] = None
    images: Mapping[str, WantedImage] = {}
    """By stream."""
    map: Optional[WantedMap] = None
    ages: bool = False
    points: Tuple[str, ...] = ()
    cloud: Optional[str] = None
    path: bool = False
    log: bool = False
    link: bool = False


class Request(NamedTuple):
    """A checked message."""
    type: str
    fields: Mapping[str, Any]
    """By name; those of FIELDS."""
    id: Optional[int]
    """None: it has none."""


def _bool(value: Any) -> bool:
    if not isinstance(value, bool):
        raise ValueError('must be true or false')
    return value


def _text(value: Any) -> str:
    if not isinstance(value, str) or len(value) > MAX_NAME:
        raise ValueError('must be a text of at most %d letters' % MAX_NAME)
    return value


def _int(least: int, most: int) -> Callable[[Any], int]:
    def check(value: Any) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
            raise ValueError('must be a whole number from %d to %d' % (least, most))
        return value
    return check


def _number(least: float, most: float) -> Callable[[Any], float]:
    def check(value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not least <= value <= most:
            raise ValueError('must be a number from %g to %g' % (least, most))
        return float(value)
    return check


def _wish(value: Any) -> str:
    if value not in ('take', 'release'):
        raise ValueError('must be take or release')
    return str(value)


def _optional(check: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda value: None if value is None else check(value)


def _list(check: Callable[[Any], Any], most: int) -> Callable[[Any], List[Any]]:
    def check_list(value: Any) -> List[Any]:
        if not isinstance(value, list) or len(value) > most:
            raise ValueError('must be a list of at most %d' % most)
        return [check(one) for one in value]
    return check_list


def _object(fields: 'Fields') -> Callable[[Any], Dict[str, Any]]:
    def check(value: Any) -> Dict[str, Any]:
        if not isinstance(value, dict):
            raise ValueError('must be an object')
        return _checked(value, fields)
    return check


Fields = Mapping[str, Tuple[Callable[[Any], Any], Any]]
"""{name: (f(value) -> checked value, raises ValueError; default, REQUIRED: none)}"""

REQUIRED = object()
ID: Fields = {'id': (_int(0, MAX_ID), REQUIRED)}
STREAM: Fields = {'stream': (_text, REQUIRED)}
RATIO, PLACE, COORDINATE = _number(-1.0, 1.0), _number(0.0, 1.0), _number(-FARTHEST, FARTHEST)

IMAGE: Fields = {**STREAM, 'width': (_int(1, MAX_WIDTH), REQUIRED), 'rate': (_number(0.1, MAX_RATE), DEFAULT_RATE)}
MAP: Fields = {**STREAM, 'level': (_int(0, MAX_LEVEL), 0), 'area': (_list(COORDINATE, 4), REQUIRED)}

FIELDS: Mapping[str, Fields] = {
    'watch': {
        'robot': (_optional(_text), None), 'images': (_list(_object(IMAGE), MAX_IMAGES), []),
        'map': (_optional(_object(MAP)), None), 'ages': (_bool, False), 'points': (_list(_text, MAX_POINTS), []),
        'cloud': (_optional(_text), None), 'path': (_bool, False), 'log': (_bool, False), 'link': (_bool, False)},
    'shown': {'number': (_int(0, 2 ** 32 - 1), REQUIRED)},
    'ping': {**ID, 'clock': (_number(-1e15, 1e15), REQUIRED)},
    'value': {**ID, **STREAM, 'x': (PLACE, REQUIRED), 'y': (PLACE, REQUIRED)},
    'still': {**ID, **STREAM},
    'captures': ID,
    'drive': {'tick': (_int(0, 2 ** 53), REQUIRED), 'x': (RATIO, REQUIRED), 'turn': (RATIO, REQUIRED),
              'y': (RATIO, 0.0)},
    'halt': {},
    'control': {**ID, 'wish': (_wish, REQUIRED)},
    'estop': {**ID, 'engage': (_bool, REQUIRED)},
    'neutral': ID,
    'focus': {**ID, 'focus': (_text, REQUIRED)},
    'goal': {**ID, 'x': (COORDINATE, REQUIRED), 'y': (COORDINATE, REQUIRED),
             'yaw': (_number(-2 * math.pi, 2 * math.pi), REQUIRED)},
    'capture': {**ID, **STREAM},
}
"""{type: its fields}"""

FOR_DRIVERS = {'drive', 'halt', 'control', 'estop', 'neutral', 'focus', 'goal', 'capture'}
"""Types that need the driver's token."""


def parse(text: str) -> Request:
    """A message.

    :raises BadRequest: it is wrong
    """
    if len(text) > MAX_SIZE:
        raise BadRequest('a message has at most %d letters' % MAX_SIZE)
    try:
        message = json.loads(text, parse_constant=_no_constant)
    except (ValueError, RecursionError):
        raise BadRequest('a message must be JSON') from None
    if not isinstance(message, dict):
        raise BadRequest('a message must be an object')
    kind, id_ = message.get('type'), message.get('id')
    if isinstance(id_, bool) or not isinstance(id_, int) or not 0 <= id_ <= MAX_ID:
        id_ = None
    if not isinstance(kind, str) or kind not in FIELDS:
        raise BadRequest('there is no such type of message', id_)
    try:
        fields = _checked(message, FIELDS[kind])
    except ValueError as error:
        raise BadRequest('%s: %s' % (kind, error), id_) from None
    return Request(kind, fields, id_)


def watch_of(fields: Mapping[str, Any]) -> Watch:
    """The Watch of a request's fields."""
    area = fields['map'] and fields['map']['area']
    if area is not None and len(area) != 4:
        raise BadRequest('watch: area must have 4 numbers')
    wanted = None
    if area is not None:
        (x0, x1), (y0, y1) = sorted(area[::2]), sorted(area[1::2])
        wanted = WantedMap(fields['map']['stream'], fields['map']['level'], (x0, y0, x1, y1))
    images = {one['stream']: WantedImage(one['width'], one['rate']) for one in fields['images']}
    return Watch(fields['robot'], images, wanted, fields['ages'], tuple(fields['points']), fields['cloud'],
                 fields['path'], fields['log'], fields['link'])


def _checked(values: Mapping[str, Any], fields: Fields) -> Dict[str, Any]:
    """:raises ValueError: which field is wrong, and how"""
    found = {}
    for name, (check, default) in fields.items():
        if name not in values:
            if default is REQUIRED:
                raise ValueError('%s is missing' % name)
            found[name] = default
            continue
        try:
            found[name] = check(values[name])
        except ValueError as error:
            raise ValueError('%s %s' % (name, error)) from None
    return found


def _no_constant(text: str) -> None:
    raise ValueError('%s is no number' % text)
