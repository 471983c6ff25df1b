# SPDX-License-Identifier: BSD-3-Clause
"""Writes when messages pass the stages of their way, and what they are like, see monitoring/stages.py, for ./smokebot
bench stages and live.

Off unless the environment names a file; then each mark is one short write, which other processes' do not mix with.
"""
import os
import time
from typing import Any, Optional, Union

import rospy

from ..monitoring.stages import Mark, Note

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
        self._write(Mark(stream, stamp, point, time.monotonic() if when is None else when))

    def note(self, stream: str, stamp: int, name: str, value: Any) -> None:
        """Something is known of a message; any thread.

        :param stamp: of the message [ns]
        :param value: its text has neither tabs nor line ends
        """
        self._write(Note(stream, stamp, name, str(value)))

    def _write(self, entry: Union[Mark, Note]) -> None:
        if self.on:
            try:
                os.write(self._file, entry.line().encode())
            except OSError as error:
                self._fail(error)

    def _fail(self, error: OSError) -> None:
        self.on = False
        rospy.logerr('%s: no marks are written: %s', VARIABLE, error)


TRACE = Trace(os.environ.get(VARIABLE))
"""Of this process."""
