# SPDX-License-Identifier: BSD-3-Clause
"""Writes when messages pass the stages of their way, see monitoring/stages.py, for ./smokebot bench stages.

Off unless the environment names a file; then each mark is one short write, which other processes' do not mix with.
"""
import os
import time
from typing import Optional, Union

import rospy

from ..monitoring.stages import Mark, Sized

VARIABLE = 'SMOKEBOT_TRACE'
"""Environment variable: the file that marks are appended to."""


class Trace:
    """Appends marks to a file; where that fails, it logs one error, and no more is written.

    :param path: None: nothing is written
    """

    def __init__(self, path: Optional[str]) -> None:
        self._file = -1
        self.on = bool(path)
        """Whether marks are written."""
        if path:
            try:
                self._file = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, 0o644)
            except OSError as error:
                self._fail(error)

    def mark(self, stream: str, stamp: int, point: str, when: Optional[float] = None) -> None:
        """A message passes a point; any thread.

        :param stamp: of the message [ns]
        :param when: by time.monotonic(); None: now [s]
        """
        self.write(Mark(stream, stamp, point, time.monotonic() if when is None else when))

    def write(self, mark: Union[Mark, Sized]) -> None:
        """Append a line; any thread."""
        if self.on:
            try:
                os.write(self._file, mark.line().encode())
            except OSError as error:
                self._fail(error)

    def _fail(self, error: OSError) -> None:
        self.on = False
        rospy.logerr('%s: no marks are written: %s', VARIABLE, error)


TRACE = Trace(os.environ.get(VARIABLE))
"""The trace of this process."""
