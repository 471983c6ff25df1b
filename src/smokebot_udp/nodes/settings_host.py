# SPDX-License-Identifier: BSD-3-Clause
"""The robot's side of the settings across the link: carries out what operators request, and sends what is in effect.

Operators with masters of their own cannot reach the robot's parameters. mission/settings_server.py decides.
"""
import threading
import time
from typing import Any, Callable, Mapping

from ..limited_log import logerr
from ..mission.control import MissionControl
from ..mission.remote import FOCUS_PART
from ..mission.settings_server import SettingsServer
from .channel import ChannelListener
from .opened import Part
from .reliable_link import ReliableLink
from .settings_messages import REQUESTS, STATES, request_of, state_data


class SettingsHost(Part):
    """Lives as long as its node.

    :param control: all requests for settings go through it
    :param carry_out: f(part, changes) -> what has changed, in words; raises ValueError where it is refused
    :param everything: whether the settings of streams cross the link, or only the focus, as with a shared master
    :param reliable: carries requests and states
    :param report: f(problem), called with what is refused
    """

    def __init__(self, control: MissionControl, carry_out: Callable[[str, Mapping[str, Any]], str], everything: bool,
                 reliable: ReliableLink, report: Callable[[str], None]) -> None:
        super().__init__()
        self._control, self._carry_out, self._all, self._report = control, carry_out, everything, report
        self._server = SettingsServer(control.profiles)
        self._updating = threading.Lock()   # otherwise an older state might be sent after a newer one; the outermost
        self._states = self._opened.add(reliable.channel(STATES, ChannelListener(joined=self._send_all)))
        self.update()
        self._opened.add(reliable.channel(REQUESTS, ChannelListener(received=self._receive)))

    def update(self) -> None:
        """Settings may have changed; any thread that holds no lock of theirs."""
        with self._updating:
            parts = self._control.parts()
            if not self._all:
                parts = {FOCUS_PART: parts[FOCUS_PART]}
            for state in self._server.update(parts):
                self._states.send(state_data(state))

    def _send_all(self, peer: str) -> None:
        """Send all parts to an operator that has joined."""
        with self._updating:
            for state in self._server.states():
                self._states.send(state_data(state), peer)

    def _receive(self, peer: str, data: bytes) -> None:
        """Serve a request; the link's thread."""
        try:
            request = request_of(data)
        except ValueError as error:
            logerr('a request for settings of %s is not served' % peer, error)
            return
        refusal = changes = ''
        try:
            self._server.check(request, time.monotonic())
            changes = self._carry_out(request.part, request.values)
        except ValueError as error:
            refusal = str(error)
            self._report('%s requests %s: refused: %s' % (peer, request.part or 'a focus', error))
        self.update()
        with self._updating:
            self._states.send(state_data(self._server.answer(request, refusal, changes)), peer)
