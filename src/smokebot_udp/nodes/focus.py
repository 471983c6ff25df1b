# SPDX-License-Identifier: BSD-3-Clause
"""The robot's mission focus, its streams' live settings, and the status of both, as ROS sees them.

A focus is switched by `rosparam set ~focus`, by dynamic_reconfigure, by the service ~set_focus, or by the
operator over the link; a stream's settings likewise under ~<stream>/. What is set by hand stands until the next
switch. mission.control decides; this is its ROS side.
"""
import functools
import threading
from typing import Any, Callable, List, Mapping, Tuple

import rospy
from dynamic_reconfigure.encoding import encode_config
from dynamic_reconfigure.msg import DoubleParameter
from std_msgs.msg import Bool

from ..limited_log import ERROR_PERIOD, logwarn
from ..mission.changes import answer
from ..mission.control import MissionControl, State
from ..mission.focus import Profile
from ..mission.remote import FOCUS_PART, FOCUS_SETTING
from ..mission.settings import Settings, SettingsStore
from ..msg import RobotStatus, StreamStatus
from ..srv import SetFocus, SetFocusResponse
from ..streams import classified
from ..units import KBIT
from .link_control import LinkControl
from .live import LiveSettings
from .logging import log_error
from .opened import Part
from .parameter_watch import ParameterWatch
from .reliable_link import ReliableLink
from .robot_control import RobotControl
from .settings_host import SettingsHost
from .stream_problems import StreamProblems
from .worker import PeriodicWorker

CHANGES_PERIOD = 10.0
"""Period at which the status is published where grants have changed: it takes 400 bytes of the link [s]."""

MAX_PROBLEMS = 6
"""In the status, which crosses the link: it takes a datagram without, and two with so many."""

FIELDS = 'enabled', 'rate', 'weight', 'min_bitrate'
"""Settings that StreamStatus has as fields of their own."""


class FocusControl(Part):
    """Serves the focus and the streams' live settings, and publishes the status.

    :param stores: {stream: SettingsStore}
    :param profiles: {name: Profile}
    :param own_masters: whether operators have masters of their own, so that all settings cross the link
    :param reliable: over which operators request a focus, and settings
    :param rate: of the link, which is divided anew after each switch of the focus
    :param driving: who drives, for the status
    :param problems: of the streams, for the status
    :param report: f(problem), called with what is refused
    """

    def __init__(self, stores: Mapping[str, SettingsStore], profiles: Mapping[str, Profile], own_masters: bool,
                 reliable: ReliableLink, rate: LinkControl, driving: RobotControl, problems: StreamProblems,
                 report: Callable[[str], None]) -> None:
        super().__init__()
        self._rate, self._driving, self._problems, self._report = rate, driving, problems, report
        self._status = rospy.Publisher('~status', RobotStatus, queue_size=1, latch=True)
        self._modified_topic = rospy.Publisher('~focus/modified', Bool, queue_size=1, latch=True)
        self._carrying_out = threading.Lock()   # otherwise an answer might name another operator's focus
        self._publishing = threading.Lock()     # otherwise an older status might be latched after a newer one
        self._published: Any = None     # what may change without a request, as it was published last
        self._show = PeriodicWorker('settings', self._show_all, log_error('settings'), None)
        self._control = MissionControl(stores, profiles, report, self._switched, self._show.wake)
        self._host = self._opened.add(SettingsHost(
            self._control, self._carry_out, own_masters, reliable, report))
        self._parts = [LiveSettings('', self._control.focus_store, report, self._control.request_focus)]
        self._parts += [LiveSettings(name, store, report, functools.partial(self._control.request, name))
                        for name, store in stores.items()]
        # a stream's own parameters take precedence over the focus
        self._watch = self._opened.add(ParameterWatch(self._parts, background=False))
        self._opened.started(self._show)
        self._changes = self._opened.started(PeriodicWorker(
            'status', self._publish_changes, log_error('status'), CHANGES_PERIOD))
        rospy.Service('~set_focus', SetFocus, self._serve)
        self._publish()
        for warning in self._control.warnings:
            logwarn('', warning, ERROR_PERIOD)
        driving.subscribe(self._changes.wake)
        problems.subscribe(self._changes.wake)

    def add(self, part: LiveSettings) -> None:
        """Serve further settings of the node, which no focus changes."""
        self._watch.add(part)

    def _switched(self, focus: str) -> None:
        self._rate.forget()
        rospy.loginfo('focus: %s', focus)
        warning = self._control.warning(focus)
        if warning:
            logwarn('', warning, ERROR_PERIOD)

    def _show_all(self) -> None:
        self._publish()
        self._host.update()
        for part in self._parts:
            part.show()

    def _serve(self, request: Any) -> Any:
        try:
            return SetFocusResponse(True, self._carry_out(FOCUS_PART, {FOCUS_SETTING: request.focus}))
        except ValueError as error:
            self._report('~set_focus: %s' % error)
            return SetFocusResponse(False, str(error))

    def _carry_out(self, part: str, changes: Mapping[str, Any]) -> str:
        """Change settings by hand, see MissionControl.request_part; what a switch of the focus changes, in words."""
        with self._carrying_out:
            before = self._streams(self._control.state())
            self._control.request_part(part, changes)
            state = self._control.state()
        if part != FOCUS_PART:
            return ''
        self._publish()
        return answer(state.focus, before, self._streams(state))

    def _publish_changes(self) -> None:
        """Publish the status where grants have changed, who drives, or what is wrong."""
        if self._published != self._changing():
            self._publish()

    def _publish(self) -> None:
        """Publish the status."""
        with self._publishing:
            state, standing = self._control.state(), self._driving.standing
            self._published = self._changing()
            status = RobotStatus(
                focus=state.focus, modified=bool(state.modified), profiles=self._control.profiles,
                driver=standing.driver, estop=standing.estop, operators=list(standing.operators),
                streams=self._streams(state),
                problems=['%s: %s' % problem for problem in list(self._problems.current.items())[:MAX_PROBLEMS]])
            status.header.stamp = rospy.Time.now()
            self._status.publish(status)
            self._modified_topic.publish(status.modified)

    def _changing(self) -> Tuple[Any, ...]:
        """What of the status may change without a request. Grants follow the link: their first digit counts."""
        granted = [None if settings.granted is None else {
            name: '%.1g' % value if isinstance(value, float) else value for name, value in settings.granted.items()}
            for settings in self._control.state().streams.values()]
        return granted, self._driving.standing, self._problems.current

    def _streams(self, state: State) -> List[Any]:
        """The StreamStatus of each stream with a share of the link."""
        shares = self._rate.shares
        return [stream_status(name, settings, self._control.configured(name), name in state.modified,
                              shares.get(name, 0.0) / KBIT)
                for name, settings in classified(state.streams).streams.items()]


def stream_status(name: str, settings: Settings, configured: Mapping[str, Any], modified: bool, share: float) -> Any:
    """A stream's StreamStatus.

    :param configured: {setting: value} of streams.yaml, of those that may change
    :param share: of the link [kbit/s]
    """
    requested = settings.requested
    others = encode_config({setting: float(requested[setting]) if type(value) is int else requested[setting]
                            for setting, value in configured.items()
                            if setting not in FIELDS and requested[setting] != value})
    return StreamStatus(
        name=name, type=requested['type'], modified=modified, share=share, paused=settings.paused,
        granted=[DoubleParameter(setting, value) for setting, value in (settings.granted or {}).items()
                 if value != requested[setting] and requested['enabled']],
        bools=others.bools, doubles=others.doubles, strs=others.strs,
        **{setting: requested[setting] for setting in FIELDS})
