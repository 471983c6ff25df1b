# SPDX-License-Identifier: BSD-3-Clause
"""Whether the compiled codec can be used, of layered images, of maps in tiles, and of clouds where PCL is missing: it
is loaded where a stream needs it first.
"""
from typing import Protocol

from .. import optional

LOOPS = 'smokebot_udp.codecs.layered.loops'
"""The module that imports numba."""


class Codec(Protocol):
    """Loads the codec."""

    def ready(self) -> bool:
        """Whether it is loaded; begins to load it."""


class ImportedCodec:
    """Imports the codec at once, and compiles it where that was not done before."""

    def ready(self) -> bool:
        return optional.attempt(LOOPS, 'numba').module is not None
