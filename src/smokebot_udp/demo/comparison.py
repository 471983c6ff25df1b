# SPDX-License-Identifier: BSD-3-Clause
"""The demo's report as text: what the robot had of each stream, what was to be sent, and what the operator received."""
import math
from typing import Any, List, Mapping, NamedTuple, Optional, Sequence

import numpy as np

GOOD_SHARE = 0.8
"""Minimum ratio of received to expected messages for a good result."""

GOOD_PSNR = 30.0
"""Minimum mean PSNR of images for a good result [dB]."""

GOOD_AGE = 0.3
"""Maximum median age of images for a good result [s]."""

HEADINGS = 'stream', 'source', 'wanted', 'expected', 'received', '', ''

LEGEND = """\
Expected: the lower of source and wanted; of relays, which are one datagram, less what was lost.
Good: %d %% of it; images of %g dB or exact, half of them at most %g s old. A slow link or a busy computer gives less.\
""" % (100 * GOOD_SHARE, GOOD_PSNR, GOOD_AGE)


class Images(NamedTuple):
    """What the operator received of an image stream."""
    psnr: Sequence[float]
    """PSNR of each image that was compared; infinite: it was exact [dB]."""
    ages: Sequence[float]
    """Age of each image when it was received [s]."""
    uncompared: int = 0
    """Number of images that were received, and not compared."""
    unlike: str = ''
    """Why some images were not compared; empty: no original had their stamps."""

    @property
    def verdict(self) -> str:
        """The verdict: good, poor, or unknown if no image could be compared."""
        lossy = self._lossy()
        if not self.ages or np.median(self.ages) > GOOD_AGE or (lossy and np.mean(lossy) < GOOD_PSNR):
            return 'poor'
        return 'good' if self.psnr else 'unknown'

    def __str__(self) -> str:
        if not self.ages:
            return ''
        median, most = 1e3 * np.asarray(np.percentile(self.ages, (50, 99)))
        return '%s, age p50 %.0f ms, p99 %.0f ms' % (self._quality(), median, most)

    def _quality(self) -> str:
        """How good they are, and of which this is known."""
        lossy, why = self._lossy(), self.unlike or 'no original has their stamps'
        if not self.psnr:
            return 'not compared: %s' % why
        quality = 'PSNR %.1f dB' % np.mean(lossy) if lossy else 'all exact'
        if not self.uncompared:
            return quality
        return '%s of %d compared, %d not compared: %s' % (quality, len(self.psnr), self.uncompared, why)

    def _lossy(self) -> List[float]:
        return [value for value in self.psnr if not math.isinf(value)]


class Compared(NamedTuple):
    """A stream on both sides."""
    name: str
    settings: Mapping[str, Any]
    source: float
    """Messages on the robot [Hz]."""
    received: float
    """Messages published for the operator [Hz]."""
    came: bool
    """Whether any was published for the operator yet: latched ones come before the report begins."""
    images: Optional[Images] = None

    def expected(self, loss: float) -> float:
        """The rate that is expected [Hz].

        :param loss: ratio of datagrams
        """
        most: float = min(self.source, self.settings['rate'])
        return most * (1 - loss) if self.settings['type'] == 'relay' else most

    def row(self, loss: float) -> Sequence[str]:
        """The texts below HEADINGS."""
        if self.settings.get('latch'):
            return self.name, '', 'latched', '', 'yes' if self.came else 'no', 'good' if self.came else 'poor', ''
        expected = self.expected(loss)
        verdict = 'poor' if self.received < GOOD_SHARE * expected else \
            'good' if self.images is None else self.images.verdict
        rates = ('%.1f Hz' % rate for rate in (self.source, self.settings['rate'], expected, self.received))
        return (self.name, *rates, verdict, '' if self.images is None else str(self.images))


def table(streams: Sequence[Compared], loss: float) -> List[str]:
    """The lines of a table of all streams.

    :param loss: ratio of datagrams
    """
    rows = [HEADINGS, *(stream.row(loss) for stream in streams)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(HEADINGS))]
    return ['  '.join(text.ljust(width) if column in (0, 5, 6) else text.rjust(width)
                      for column, (text, width) in enumerate(zip(row, widths))).rstrip() for row in rows]
