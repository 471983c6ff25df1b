# SPDX-License-Identifier: BSD-3-Clause
"""The film strip: at some moments of the mission, the original on the robot beside what the operator saw."""
import math
from typing import Any, Dict, List, NamedTuple, Optional, Sequence, Tuple

import cv2
import numpy as np

from ..arrays import Array, UInt8Array
from ..codecs.display.colouring import Colouring
from ..codecs.wire.pixels import image_pixels
from ..streams.image.source import raw_image
from .bags import BagFile
from .mission import Mission
from .page import Moment, Picture
from .record import OPERATOR, ROBOT
from .summary import Event, events

WIDTH = 320
"""Width of an image of the strip [pixel]."""

QUALITY = 80
"""Quality of JPEG images, 0..100."""

MAX_STREAMS = 2
"""Maximum number of image streams in a strip."""

MAX_EVENTS = 12
"""Maximum number of moments of events."""

KINDS = 'stop', 'gap', 'focus'
"""Kinds of events with a moment, the most important first."""

LOW, HIGH = 1, 99
"""The colours of the original, and of what was seen of it, are between these percentiles of its pixels."""


APART = 0.5
"""An image that was not recorded is shown by one whose stamp is no further away [s]."""

Place = Tuple[int, str, float]
"""As in Wanted: bag, topic, time."""


class _Seen(NamedTuple):
    """The last image at some time."""
    stamp: float
    """[s]"""
    shown: float
    """Stamp of the image that was recorded: this one, or the nearest [s]."""
    place: Place


class Wanted(NamedTuple):
    """An image of the strip."""
    side: str
    bag: int
    topic: str
    time: float
    """When it was recorded, by the side's clock [s]."""
    caption: str


def moments(mission: Mission, opened: Sequence[BagFile], count: int) -> List[Moment]:
    """The strip.

    :param opened: the bags by their numbers
    :param count: moments that are spread evenly; those of events are added
    """
    streams = mission.streams('image')[:MAX_STREAMS]
    chosen = [(time, title, [wanted(mission, name, time) for name in streams]) for time, title in times(mission, count)]
    images = _read(opened, [one for _, _, pairs in chosen for pair in pairs for one in pair if one])
    found = []
    for time, title, pairs in chosen:
        pictures = [picture for pair in pairs for picture in _pictures(pair, images)]
        if pictures:
            found.append(Moment(time, title, pictures))
    return found


def times(mission: Mission, count: int) -> List[Tuple[float, str]]:
    """The moments: evenly spread ones and those of events, by time."""
    begin, end = mission.common
    spread = [(float(time), '') for time in np.linspace(begin, end, count + 2)[1:-1]]
    happened = [event for event in events(mission) if event.kind in KINDS and begin <= event.time <= end]
    happened.sort(key=lambda event: KINDS.index(event.kind))
    return sorted(spread + [(_best_time(event, mission), event.text) for event in happened[:MAX_EVENTS]])


def _best_time(event: Event, mission: Mission) -> float:
    """A gap shows best what was missed when it is a second old; other events when they begin."""
    return min(event.time + 1.0, mission.common[1]) if event.kind == 'gap' else event.time


def wanted(mission: Mission, name: str, time: float) -> List[Optional[Wanted]]:
    """[the robot's image, the operator's] of a stream at a time; None: there is none.

    The operator's is the last one until then. The robot's is its original while it is not older than a second; later
    the one that was new at that time. Where an image was not recorded, it is the nearest one that was.
    """
    seen, shown, original = _last(mission, OPERATOR, name, time), None, None
    if seen is not None:
        age = time - seen.stamp
        shown = Wanted(OPERATOR, *seen.place, '%s: operator, %.1f s old' % (name, age))
        found = _at_stamp(mission, name, seen.shown) if age <= 1.0 else None
        if found is not None:
            original = Wanted(ROBOT, *found, '%s: original' % name)
    last = _last(mission, ROBOT, name, time)
    if original is None and last is not None:
        original = Wanted(ROBOT, *last.place, '%s: robot at this time' % name)
    return [original, shown]


def _last(mission: Mission, side: str, name: str, time: float) -> Optional[_Seen]:
    """The last image until a time; None: there is none."""
    track = mission.record.tracks[side].get(name)
    index = int(np.searchsorted(mission.times(side, name), time, side='right')) - 1
    if track is None or index < 0:
        return None
    recorded, stamps, files = track.sorted()
    stamp = float(stamps[index] if np.isfinite(stamps[index]) else mission.times(side, name)[index])
    return _nearest(mission, side, name, stamp) or _Seen(
        stamp, stamp, (int(files[index]), track.topic, float(recorded[index])))


def _nearest(mission: Mission, side: str, name: str, stamp: float) -> Optional[_Seen]:
    """What the black box has compressed nearest to a stamp; None: nothing that is near."""
    images = mission.record.images.get((side, name), {})
    shown = min(images, key=lambda other: abs(other - stamp), default=math.inf)
    if abs(shown - stamp) > APART:
        return None
    came, bag, topic = images[shown]
    return _Seen(stamp, shown, (bag, topic, came))


def _at_stamp(mission: Mission, name: str, stamp: float) -> Optional[Place]:
    """Where the robot's image with a stamp is; None: it was not recorded."""
    track = mission.record.tracks[ROBOT].get(name)
    if track is None:
        return None
    found = _nearest(mission, ROBOT, name, stamp)
    if found is not None:
        return found.place
    recorded, stamps, files = track.sorted()
    index = np.flatnonzero(stamps == stamp)
    return (int(files[index[0]]), track.topic, float(recorded[index[0]])) if len(index) else None


def _read(opened: Sequence[BagFile], images: Sequence[Wanted]) -> Dict[Tuple[int, str, float], Any]:
    """{(bag, topic, time): message}: each bag is opened once."""
    found = {}
    for number in sorted({one.bag for one in images}):
        keys = sorted({(one.topic, one.time) for one in images if one.bag == number})
        found.update({(number, *key): message for key, message in opened[number].messages(keys).items()})
    return found


def _pictures(pair: Sequence[Optional[Wanted]], images: Dict[Tuple[int, str, float], Any]) -> List[Picture]:
    """Both images of a pair in the same colours; those that cannot be shown are missing."""
    decoded = [(one, _decoded(images.get((one.bag, one.topic, one.time)))) for one in pair if one]
    known = [(one, *image) for one, image in decoded if image is not None]
    if not known:
        return []
    colouring = Colouring('inferno', *_range(known[0][1]))
    return [Picture(_jpeg(colouring(pixels, encoding, 0.0).pixels), 'jpeg', one.caption)
            for one, pixels, encoding in known]


def _decoded(message: Any) -> Optional[Tuple[Array, str]]:
    """(pixels, encoding) of an image; None: it cannot be shown."""
    if message is None:
        return None
    try:
        image = raw_image(message)
        return image_pixels(image), image.encoding
    except (AttributeError, ValueError):
        return None


def _range(pixels: Array) -> Tuple[float, float]:
    """The values between which the colours of 16-bit and float images are."""
    values = pixels[np.isfinite(pixels)].astype(float)
    if not len(values):
        return 0.0, 1.0
    low, high = np.asarray(np.percentile(values, [LOW, HIGH]))
    return float(low), float(max(high, low + 1e-3))


def _jpeg(image: UInt8Array) -> bytes:
    """An image as JPEG, no wider than WIDTH."""
    height, width = image.shape[:2]
    if width > WIDTH:
        image = cv2.resize(image, (WIDTH, max(1, height * WIDTH // width)), interpolation=cv2.INTER_AREA)
    return bytes(cv2.imencode('.jpg', image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1])
