# SPDX-License-Identifier: BSD-3-Clause
"""The ways of sending video that are compared, by name."""
from typing import Any, Dict, Optional, Tuple

from smokebot_udp.link_lab.channel import LinkConditions

from . import video_peers
from .video_clips import Clip
from .video_jpeg import Jpegs, JpegVideo
from .video_link import CHOICE_IMAGES, Way
from .video_package import PackageVideo
from .video_peers import NIMBRO_NETWORK, Encodings, Video

H264, PREDICTED, LAYERED = 'H.264 (this package)', 'layered, predicted (this package)', 'layered (this package)'
NIMBRO, SLICES, FIXED = 'H.264 as nimbro_network', 'H.264 slices', 'H.264 slices + 25 %'
KNOWN, JPEG = 'H.264 slices, loss known', 'JPEG, loss known'

OURS = H264, PREDICTED, LAYERED
PEERS = NIMBRO, SLICES, FIXED, KNOWN, JPEG
CODINGS = {H264: 'h264', PREDICTED: 'layered', LAYERED: 'layered'}
"""{way of this package: the setting `coding`}"""

REFRESH, REFRESHES = 10, (10, 5, 1)
"""Images within which all is intra-coded once; what is chosen from where the loss is known."""

FIXED_SHARE = 0.25

class Ways:
    """All ways of sending a clip.

    :param quick: whether what knows the loss is chosen from few candidates
    """

    def __init__(self, clip: Clip, quick: bool = False) -> None:
        self.clip = clip
        self._encodings, self._short = Encodings(clip), Encodings(clip[:CHOICE_IMAGES])
        self._candidates = [video_peers.sliced(refresh) for refresh in REFRESHES[:1 if quick else None]]
        self._jpegs: Optional[Jpegs] = None     # it takes a while to encode them
        self._chosen: Dict[Tuple[float, LinkConditions], video_peers.Known] = {}

    def make(self, way: str, rate: float, conditions: LinkConditions, seed: object) -> Way:
        """A way at a rate [bit/s] on a link; what knows the loss knows the link, and nothing else does."""
        if way in OURS:
            return PackageVideo(CODINGS[way], rate, self.clip[0], 1.0 if way == LAYERED else conditions.loss, seed)
        if way == JPEG:
            self._jpegs = self._jpegs or Jpegs(self.clip)
            return JpegVideo(self._jpegs, self._jpegs.code(rate, conditions))
        coding, parities = self._coded(way, rate, conditions)
        encoded = self._encodings.fitted(coding, rate, parities)
        return Video(encoded, coding, self.clip[0].shape, parities, mended=way != NIMBRO)

    def _coded(self, way: str, rate: float, conditions: LinkConditions) -> Any:
        """A coding, and what its code adds."""
        if way == KNOWN:
            if (rate, conditions) not in self._chosen:
                self._chosen[rate, conditions] = video_peers.known_loss(
                    self._short, rate, conditions, self._candidates)
            return self._chosen[rate, conditions]
        if way == NIMBRO:
            return NIMBRO_NETWORK, video_peers.redundancy(0.0)
        return video_peers.sliced(REFRESH), video_peers.redundancy(FIXED_SHARE if way == FIXED else 0.0)
