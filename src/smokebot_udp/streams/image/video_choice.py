# SPDX-License-Identifier: BSD-3-Clause
"""Chooses between layered coding and video of 8-bit images: part of `coding: auto`.

Video predicts each image from the one before: where they resemble each other it shows more by the same bytes. Layered
images become exact, and any datagram shows one, whatever was received before. So images are video where the link has no
room for good layered ones, and as long as the scene is much the same from one image to the next, but does not stand
still. With hysteresis: a change costs the first images their quality.
"""
from typing import NamedTuple, Optional

GOOD = 42.0
"""PSNR of a good layered image [dB]."""

SCARCE, STILL_SCARCE = 1.0, 1.4
"""The link has no room for good layered images if it has this part of what they take; once in use, until it has that
part."""

ALIKE, STILL_ALIKE = 0.2, 0.4
"""Images resemble each other if the mean squared difference of two is this part of what that of two independent ones
would be, at most; once in use, until it is that part."""

STANDING, STILL_STANDING = 1e-4, 2e-4
"""The scene stands still, without noise, if it is less than this part; until it is that part. Layered images of it
become exact."""

LEAST_BITS, ENOUGH_BITS = 0.01, 0.015
"""Of a video image at the coarsest quantiser, which is refreshed; without room for it images are not sent. Room for so
much brings video back [bit per pixel]."""

HOLD = 2.0
"""Conditions for a change must hold for this long [s]."""

PROBE = 10.0
"""While images are video, what a good layered one takes is measured this often [s]."""


class VideoConditions(NamedTuple):
    """What the choice depends on."""
    ratio: Optional[float]
    """See Similarity."""
    room: float
    """What the link has for an image [byte on the air]."""
    needed: Optional[float]
    """What a layered image of GOOD quality takes [byte on the air]; None: it was not measured yet, inf: there are no
    layered ones."""
    area: int = 0
    """Of an image [pixel]."""


class VideoChoice:
    """Whether images are video. Times are by a steady clock [s]."""

    def __init__(self) -> None:
        self.video = False
        """As chosen last."""
        self._has_room = True
        self._since: Optional[float] = None     # when conditions for a change began to hold
        self._measured = 0.0                    # when `needed` was measured last

    def measured(self, now: float) -> None:
        """Note that `needed` was measured."""
        self._measured = now

    def is_due(self, now: float) -> bool:
        """Whether `needed` is to be measured although images are video."""
        return self.video and now - self._measured >= PROBE

    def has_room(self, room: float, area: int) -> bool:
        """Whether the link has room for the next video image.

        :param room: see VideoConditions
        :param area: of an image [pixel]
        """
        self._has_room = room >= (LEAST_BITS if self._has_room else ENOUGH_BITS) / 8 * area
        return self._has_room

    def update(self, conditions: VideoConditions, now: float) -> bool:
        """Choose for the next image."""
        if conditions.needed is None or conditions.ratio is None:
            return self.video
        if self._is_better(conditions, conditions.ratio, conditions.needed) == self.video:
            self._since = None
            return self.video
        self._since = now if self._since is None else self._since
        if now - self._since >= HOLD:
            self.video, self._since, self._measured = not self.video, None, now
        return self.video

    def _is_better(self, conditions: VideoConditions, ratio: float, needed: float) -> bool:
        scarce, alike, standing = ((STILL_SCARCE, STILL_ALIKE, STANDING) if self.video else
                                   (SCARCE, ALIKE, STILL_STANDING))
        return (standing <= ratio <= alike and self.has_room(conditions.room, conditions.area)
                and conditions.room <= scarce * needed)
