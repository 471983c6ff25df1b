# SPDX-License-Identifier: BSD-3-Clause
"""The operator's side of camera_info: which of the received calibrations an image has."""
import copy
import math
from typing import Counter, Dict, Optional

from sensor_msgs.msg import CameraInfo

from ...arrays import Records
from ...msg import CameraInfoSegment
from ...serialised import deserialised
from .camera_info import image_size

REMEMBERED = 8
"""Calibrations that are kept: an image is shown at most some images after the calibration changed."""

BACK = 5 * 10 ** 9
"""Stamps that go back by more than this begin anew, as where a recording is repeated [ns]."""


class InfoHistory:
    """The calibrations received last. `receive` is called by one thread, `of` by any.

    :param dropped: {reason: count} of segments that are refused
    """

    def __init__(self, dropped: Counter[str]) -> None:
        self._dropped = dropped
        self._known: Dict[int, CameraInfo] = {}     # by the stamp since which they apply [ns]; replaced, not changed
        self.unknown = False
        """Whether that of the last image was not known."""

    def receive(self, record: Records) -> None:
        """Take a segment.

        :param record: of CameraInfoSegment
        """
        try:
            segment = deserialised(CameraInfoSegment, record.tobytes())
        except ValueError:
            self._dropped['camera_info'] += 1
            return
        info, since = segment.info, segment.since.to_nsec()
        if not all(map(math.isfinite, (*info.D, *info.K, *info.R, *info.P))) or segment.header.stamp < segment.since:
            self._dropped['camera_info'] += 1
            return
        if self._known.get(since) == info:
            return
        later = max(self._known, default=since)
        kept = {} if since < later - BACK and segment.header.stamp.to_nsec() < later - BACK else self._known
        self._known = dict(sorted({**kept, since: info}.items())[-REMEMBERED:])

    def of(self, stamp: int, height: int, width: int) -> Optional[CameraInfo]:
        """The calibration of an image, without its header; None: it is not known.

        :param stamp: [ns]
        """
        known = self._known
        since = max((begin for begin in known if begin <= stamp), default=None)
        found = known.get(since) if since is not None else None
        self.unknown = found is None or image_size(found) != (height, width)
        return None if self.unknown else copy.copy(found)
