# SPDX-License-Identifier: BSD-3-Clause
"""The view of an image stream: an annotated colour image for display, in which an old image never looks live."""
import math
from dataclasses import dataclass
from typing import Any, Mapping, NamedTuple, Optional

import numpy as np

from ...arrays import Array, UInt8Array
from ...codecs.display.colouring import PALETTES, AutomaticRange, Coloured, Colouring
from ...codecs.display.view import Judgement, Limits, framed, judged
from ...image_error import ImageError
from ...mission.parameters import Parameter

PARAMETERS = {
    'view_topic': Parameter('', '', "operator's topic of the view, an annotated colour image for display with age and "
                            'completeness or error; empty: operator_topic with /view appended; none: no view'),
    'palette': Parameter('inferno', '', 'colour map of 16-bit and float images', choices=PALETTES, live=True),
    'range_low': Parameter(0.0, '', 'lower end of the colour map, in units', live=True),
    'range_high': Parameter(0.0, '', 'upper end; if it is not above range_low, both follow the scene', live=True),
    'counts_per_unit': Parameter(1.0, '', "a pixel's value / counts_per_unit + zero is in units", above=0.0, live=True),
    'zero': Parameter(0.0, '', 'see counts_per_unit', live=True),
    'unit': Parameter('counts', '', 'name of the unit, shown beside the scale', live=True),
    'old_after': Parameter(0.5, 's', 'age from which the frame is yellow', above=0.0, most=3600.0, live=True),
    'frozen_after': Parameter(2.0, 's', 'age from which the frame is red and the image grey', above=0.0, most=3600.0,
                              live=True),
    'least_psnr': Parameter(20.0, 'dB', 'estimated PSNR of a layered or video image below which the frame is yellow; '
                            'with a colour map it is relative to the range of the colours', least=0.0, most=100.0,
                            live=True),
    'least_complete': Parameter(0.5, '', 'share of received pixels below which the frame is yellow', least=0.0,
                                most=1.0, live=True),
}
COLOURS = {'palette', 'range_low', 'range_high', 'counts_per_unit', 'zero', 'unit'}
"""Settings that need another Colouring."""
REMIND_PERIOD = 0.5
"""An old image is drawn again, older, at this period [s]."""
PLACEHOLDER = Coloured(np.full((480, 640, 3), 80, np.uint8))


@dataclass
class ViewedImage:
    """An image that was received, or the placeholder before the first one."""
    header: Any
    """std_msgs/Header of the source."""
    completeness: float
    """Share of the pixels that are not concealed, 0..1."""
    age: float = math.inf
    """When it was received, by its stamp [s]."""
    received: float = -math.inf
    """When it was received, by a steady clock [s]."""
    pixels: Optional[Array] = None
    """(height, width) or (height, width, channels), see codecs.wire.pixels.as_pixels; None: coloured already."""
    encoding: str = ''
    """Encoding of `pixels`, as in sensor_msgs/Image."""
    coloured: Optional[Coloured] = None
    """The coloured image; None until it is drawn."""
    error: Optional[ImageError] = None
    """Error of an image that was coded with loss; None: it is exact, or its error is unknown."""
    at_least: bool = False
    """Whether `age` is a lower bound: the stamp does not say when the image was taken, and `age` counts from
    robot_sender on."""


class Judged(NamedTuple):
    """The parts of a view."""
    coloured: Coloured
    judgement: Judgement
    limits: Limits
    notice: str
    """Empty: none."""


class View:
    """Decides when which image is drawn, and draws it.

    A new image is drawn once, at once. The last one is drawn again with another notice. While none is received, it is
    drawn again when its state changes and every REMIND_PERIOD. Of images that are received faster than they can be
    drawn, only the newest is. If one cannot be drawn, the one before goes on growing old. Without viewers nothing is
    drawn; the newest image is kept for them.

    One thread calls `draw`, without the lock that guards everything else.

    :param settings: {name: value} with those of PARAMETERS, checked
    :param header: std_msgs/Header before the first image
    """

    def __init__(self, settings: Mapping[str, Any], header: Any) -> None:
        self._limits = _limits(settings)
        self._colouring = colouring_of(settings)
        self._drawn = ViewedImage(header, 0.0, coloured=PLACEHOLDER)
        self._waiting: Optional[ViewedImage] = None
        self._reminded = -math.inf      # when `poll` returned an old image last, or would have [s]
        self._notice, self._noticed = '', True      # the text, and whether `poll` returned an image since it changed

    def configure(self, settings: Mapping[str, Any], changed: Mapping[str, Any]) -> None:
        """Apply changed settings. An automatic range is kept.

        :param settings: {name: value} with those of PARAMETERS, checked
        :param changed: {name: value} of those that differ from before
        """
        if COLOURS & set(changed):
            self._colouring = colouring_of(settings, self._colouring.automatic)
        if PARAMETERS.keys() & set(changed):
            self._limits = _limits(settings)
            self._reminded = -math.inf      # an old image shows the change at once

    def add(self, image: ViewedImage) -> None:
        """Take an image that was received."""
        self._waiting = image

    def set_notice(self, text: str) -> None:
        """Show a notice from now on, such as EMERGENCY STOP; empty: none."""
        if text != self._notice:
            self._notice, self._noticed = text, False

    def deadline(self) -> float:
        """When `poll` returns an image next, unless one is added [s]."""
        if not self._noticed:
            return -math.inf
        newest = self._waiting or self._drawn
        old_at = newest.received + self._limits.old_after
        if self._reminded < old_at:
            return old_at
        frozen_at = newest.received + self._limits.frozen_after - max(newest.age, 0.0)
        due = self._reminded + REMIND_PERIOD
        return min(due, frozen_at) if self._reminded < frozen_at else due

    def poll(self, now: float, wanted: bool) -> Optional[ViewedImage]:
        """The image to be drawn now; None: none.

        :param now: by the clock of ViewedImage.received [s]
        :param wanted: whether there is any viewer
        """
        if wanted and self._waiting is not None:
            image, self._waiting = self._waiting, None
            self._noticed = True
            return image
        if now < self.deadline():
            return None
        self._reminded, self._noticed = now, True
        return self._drawn if wanted else None

    def draw(self, image: ViewedImage, now: float) -> UInt8Array:
        """The view of an image.

        :return: (height, width, 3) uint8, bgr
        :raises ValueError: where the image cannot be drawn
        """
        silence = now - image.received
        view = framed(self._coloured(image), image.age + silence, image.completeness, self._limits, silence,
                      image.error, self._notice, image.at_least)
        self._drawn = image
        return view

    def judge(self, image: ViewedImage, now: float) -> Judged:
        """The view of an image as its parts, for displays that draw their own; as `draw` otherwise.

        :raises ValueError: where the image cannot be shown
        """
        silence, coloured = now - image.received, self._coloured(image)
        judgement = judged(coloured, image.age + silence, image.completeness, self._limits, silence, image.error)
        self._drawn = image
        return Judged(coloured, judgement, self._limits, self._notice)

    def _coloured(self, image: ViewedImage) -> Coloured:
        if image.coloured is None:
            assert image.pixels is not None
            image.coloured, image.pixels = self._colouring(image.pixels, image.encoding, image.received), None
        return image.coloured


def _limits(settings: Mapping[str, Any]) -> Limits:
    return Limits(settings['old_after'], settings['frozen_after'], settings['least_complete'], settings['least_psnr'])


def colouring_of(settings: Mapping[str, Any], automatic: Optional[AutomaticRange] = None) -> Colouring:
    """The colours of a stream.

    :param settings: {name: value} with those of PARAMETERS, checked
    :param automatic: the state of an automatic range that goes on
    """
    return Colouring(settings['palette'], settings['range_low'], settings['range_high'], settings['counts_per_unit'],
                     settings['zero'], settings['unit'], automatic)
