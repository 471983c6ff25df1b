# SPDX-License-Identifier: BSD-3-Clause
"""Whether the compiled codec can be used, of layered images and of maps in tiles: it is loaded where a stream needs it
first.
"""
from typing import Protocol


class Codec(Protocol):
    """Loads the codec."""

    def ready(self) -> bool:
        """Whether it is loaded; begins to load it."""


class ImportedCodec:
    """Imports the codec at once, and compiles it where that was not done before."""

    def ready(self) -> bool:
        try:
            from ..codecs.layered import loops
        except ImportError:
            return False
        return loops is not None
