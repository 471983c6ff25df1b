# SPDX-License-Identifier: BSD-3-Clause
"""An rviz configuration for a robot whose frames have a prefix.

rviz's option -f sets the fixed frame only; the view follows another one.
"""
import re

from ..streams import frame_prefix

FRAMES = re.compile(r'^( *(?:Fixed|Target|Reference) Frame: )(?!<)(\S.*)$', re.MULTILINE)
"""Lines that name a frame; <Fixed Frame> is not a name."""


def with_prefix(text: str, prefix: str) -> str:
    """The text of an .rviz file whose frames have the prefix."""
    return FRAMES.sub(lambda line: line.group(1) + frame_prefix.with_prefix(line.group(2), prefix), text)
