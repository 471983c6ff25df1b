# SPDX-License-Identifier: BSD-3-Clause
"""Names of tf frames, as tf2 has them: some ROS 1 drivers still begin a frame with a slash, and tf2 knows no `/map`."""
import re

UNKNOWN = 'tf knows no transform'

LEGAL = re.compile(r'[A-Za-z_][A-Za-z0-9_./-]{0,99}\Z')
"""Names that are taken from messages, and into files."""

FIXED_FRAME, BASE_FRAME = 'map', 'base_link'
"""REP-105: of a robot whose streams.yaml names none."""


def frame_name(frame_id: str) -> str:
    """A frame_id as tf2 knows it: frames are compared, looked up and prefixed by it."""
    return frame_id.lstrip('/')


def is_legal(frame: str) -> bool:
    """Whether it is the name of a frame, without a slash at the beginning."""
    return LEGAL.match(frame) is not None


def unknown_transform(frame_id: str, into: str, instead: str) -> str:
    """A warning: tf cannot transform from one frame into another.

    :param instead: what is done without
    """
    return '%s from %r to %r: %s' % (UNKNOWN, frame_name(frame_id), frame_name(into), instead)


def is_unknown_transform(warning: str) -> bool:
    """Whether a warning is one of `unknown_transform`."""
    return warning.startswith(UNKNOWN)
