# SPDX-License-Identifier: BSD-3-Clause
"""Names of tf frames, as tf2 has them: some ROS 1 drivers still begin a frame with a slash, and tf2 knows no `/map`."""

UNKNOWN = 'tf knows no transform'


def frame_name(frame_id: str) -> str:
    """A frame_id as tf2 knows it: frames are compared, looked up and prefixed by it."""
    return frame_id.lstrip('/')


def unknown_transform(frame_id: str, into: str, instead: str) -> str:
    """A warning: tf cannot transform from one frame into another.

    :param instead: what is done without
    """
    return '%s from %r to %r: %s' % (UNKNOWN, frame_name(frame_id), frame_name(into), instead)


def is_unknown_transform(warning: str) -> bool:
    """Whether a warning is one of `unknown_transform`."""
    return warning.startswith(UNKNOWN)
