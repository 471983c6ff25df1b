# SPDX-License-Identifier: BSD-3-Clause
"""What is wrong with a node's streams now: one line in the log for each problem, and for its end."""
import threading
from typing import Callable, Dict, List, Mapping, Optional, Set

import rospy

from ..limited_log import kind_of, logwarn

MAX_TEXT = 120
"""Maximum length of the text of a problem in RobotStatus, which crosses the link [characters]."""


class StreamProblems:
    """Holds the problems. Any thread may call it.

    :param refused: {stream: why it does not run}
    """

    def __init__(self, refused: Mapping[str, str]) -> None:
        self._refused = refused
        self._found: Dict[str, str] = {}
        self._missing: Dict[str, str] = {}      # with their sources
        self._logged: Set[str] = set()          # whose sources are missing
        self._lock = threading.Lock()
        self._listeners: List[Callable[[], None]] = []

    def subscribe(self, listener: Callable[[], None]) -> None:
        """Call f() after each change."""
        self._listeners.append(listener)

    @property
    def current(self) -> Dict[str, str]:
        """{stream: what is wrong}"""
        with self._lock:
            return {name: text[:MAX_TEXT] for name, text in {**self._found, **self._refused}.items() if text}

    def note(self, stream: str, source: Optional[str], other: Optional[str] = None) -> None:
        """Note what is wrong with a stream now; None: nothing is.

        :param source: with its source; it is logged
        :param other: another problem, which has been logged
        """
        now = source or other or ''
        with self._lock:
            before, self._found[stream] = self._found.get(stream, ''), now
            missing, self._missing[stream] = self._missing.get(stream, ''), source or ''
        if source and kind_of(missing) != kind_of(source):
            if logwarn("stream '%s'" % stream, source):
                self._logged.add(stream)
        elif not source and stream in self._logged:
            self._logged.remove(stream)
            rospy.loginfo("stream '%s': this is over: %s", stream, missing)
        if kind_of(before) != kind_of(now):
            for listener in self._listeners:
                listener()
