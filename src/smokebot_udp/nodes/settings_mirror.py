# SPDX-License-Identifier: BSD-3-Clause
"""The operator's side of the settings across the link: ~set_focus, and the robot's settings at the operator's master.

They are where they would be with a shared master, in the operator's namespace: robot_sender/set_focus,
robot_sender/focus and robot_sender/<stream>/, for rosparam and dynamic_reconfigure. mission/settings_client.py decides.
"""
import functools
import queue
import time
from typing import Any, Callable, Dict, Mapping, Optional, Tuple

import rospy

from ..limited_log import logerr
from ..mission.parameters import Table
from ..mission.remote import Request
from ..mission.settings_client import SettingsClient
from ..srv import SetFocus, SetFocusResponse
from .channel import ChannelListener
from .live import LiveSettings
from .logging import log_error
from .opened import Part
from .parameter_watch import ParameterWatch
from .reliable_link import ReliableLink
from .settings_messages import REQUESTS, STATES, request_data, state_of
from .worker import DeadlineWorker, PeriodicWorker

ENDING = 1.0
"""The node ends where a request is neither answered nor given up within this time after its timeout [s]."""


class SettingsMirror(Part):
    """Lives as long as its node.

    :param node: resolved name of the robot's node, as if it were at this master; None: it is there already
    :param tables: {stream: {setting: Parameter}} of the robot's settings that may change
    :param reliable: carries requests and states
    :param timeout: of set_focus [s]
    :param report: f(problem), called with what is refused
    """

    def __init__(self, node: Optional[str], tables: Mapping[str, Table], reliable: ReliableLink, timeout: float,
                 report: Callable[[str], None]) -> None:
        super().__init__()
        self._node, self._timeout, self._report = node, timeout, report
        self._client = SettingsClient(tables)
        self._parts: Dict[str, LiveSettings] = {}
        self._watch = None if node is None else ParameterWatch([], background=True, node=node)
        self._worker: DeadlineWorker[Request] = DeadlineWorker(
            'requests for settings', self._poll, self._client.deadline, self._send, log_error('requests for settings'))
        # not in the link's thread: the master is asked
        self._show = PeriodicWorker("the robot's settings", self._show_changed, log_error("the robot's settings"), None)
        self._requests = self._opened.add(reliable.channel(REQUESTS, ChannelListener(joined=self._joined)))
        self._opened.started(self._worker)
        self._opened.started(self._show)
        if self._watch is not None:
            self._opened.add(self._watch)
        self._opened.add(reliable.channel(STATES, ChannelListener(received=self._receive)))
        for name in ('~set_focus', *([node + '/set_focus'] if node else [])):
            rospy.Service(name, SetFocus, self._set_focus)

    def _joined(self, peer: str) -> None:
        """Send what was not answered again: it may not have arrived; the link's thread."""
        with self._worker.changing():
            self._client.begin_again()

    def _receive(self, peer: str, data: bytes) -> None:
        """Take a state; the link's thread."""
        try:
            state = state_of(data)
        except ValueError as error:
            logerr("a state of the robot's settings is not shown", error)
            return
        with self._worker.changing():
            self._client.receive(state)
            self._follow()

    def _request(self, part: str, changes: Mapping[str, Any]) -> Dict[str, Any]:
        """As SettingsStore.request; any thread."""
        with self._worker.changing():
            return self._client.request(part, changes, time.monotonic())

    def _set_focus(self, asked: Any) -> Any:
        """Serve SetFocus: the response, when the robot has answered."""
        answers: queue.Queue[Tuple[str, str]] = queue.Queue()
        try:
            with self._worker.changing():
                self._client.switch(asked.focus, self._timeout, time.monotonic(),
                                    lambda *answer: answers.put(answer))
            refusal, changes = answers.get(timeout=self._timeout + ENDING)
        except (ValueError, queue.Empty) as error:
            return SetFocusResponse(False, str(error) or 'this node has ended')
        return SetFocusResponse(not refusal, refusal or changes)

    def _poll(self, now: float) -> Optional[Request]:
        request = self._client.poll(now)
        self._follow()
        return request

    def _send(self, request: Request) -> None:
        self._requests.send(request_data(request))

    def _follow(self) -> None:
        if self._client.news:
            self._show.wake()

    def _show_changed(self) -> None:
        """Report what was refused, and show what has changed."""
        with self._worker.changing():
            problems, changed = self._client.take_news()
        for name, problem in problems:
            self._report('%s: %s' % ('/'.join(filter(None, (self._node or 'the robot', name))), problem))
        if self._watch is None or self._node is None:
            return
        for name in changed:
            part = self._parts.get(name)
            if part is not None:
                part.show()
                continue
            self._parts[name] = LiveSettings(name, self._client.stores[name], self._report,
                                             functools.partial(self._request, name), self._node)
            self._watch.add(self._parts[name])
