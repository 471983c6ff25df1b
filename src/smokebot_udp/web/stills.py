# SPDX-License-Identifier: BSD-3-Clause
"""Pictures that somebody wants to keep, with their numbers, until the browser has fetched them."""
import json
import math
import secrets
from typing import Any, Dict, Mapping, Optional, Tuple

from ..newest import Newest
from .pictures import Encoded, Picture, metadata
from .png import encoded
from .screen import Now

MOST = 16
"""That are kept."""


class Stills:
    """Any thread may add one."""

    def __init__(self) -> None:
        self._kept: Newest[str, Tuple[bytes, bytes]] = Newest(MOST)

    def keep(self, robot: str, stream: str, picture: Picture, now: Now) -> Dict[str, Any]:
        """Keep a picture; returns the paths of its files, and its numbers."""
        values = {'robot': robot, 'stream': stream,
                  **metadata(picture, Encoded(b'', picture.pixels.shape[1], picture.pixels.shape[0]), now.steady,
                             now.clock),
                  **{name: value for name, value in picture.values.items()
                     if not isinstance(value, float) or math.isfinite(value)}}
        name = secrets.token_hex(8)
        self._kept[name] = encoded(picture.pixels), (json.dumps(values, indent=2) + '\n').encode()
        return {'image': '/stills/%s.png' % name, 'numbers': '/stills/%s.json' % name, 'values': values}

    def get(self, name: str) -> Optional[Tuple[str, bytes]]:
        """The media type and content of a file; None: there is none."""
        stem, _, end = name.partition('.')
        kept: Mapping[str, Tuple[bytes, bytes]] = self._kept
        if stem not in kept or end not in ('png', 'json'):
            return None
        return ('image/png', kept[stem][0]) if end == 'png' else ('application/json', kept[stem][1])
