# SPDX-License-Identifier: BSD-3-Clause
"""The robot's mission focus and its streams' live settings, and the status that tells of them.

A focus is switched by `rosparam set ~focus`, by dynamic_reconfigure, by the service ~set_focus, or by the
operator over the link; a stream's settings likewise under ~<stream>/. What is set by hand stands until the next
switch.
"""
import threading

import rospy
from std_msgs.msg import Bool

from .. import udpros
from ..mission.focus import Profile
from ..mission.parameters import Parameter, check_one, live
from ..msg import FocusRequest, RobotStatus, StreamStatus
from ..srv import SetFocus, SetFocusResponse
from ..streams.rate import Repeater
from .allocation import KBIT
from .live import LiveSettings, ParameterWatch

AS_CONFIGURED = 'default'
GRANTS_TOLD = 1.0
"""What the link leaves of the settings is told so often, where it changes [s]."""

REQUESTS = 'smokebot_udp/focus/request'
"""Where the operator's requests cross."""


def valid_profiles(profiles, streams):
    """The profiles for the streams there are.

    :param profiles: {name: supervisor.focus.Profile}
    :param streams: {name: RobotStream}
    :return: ({name: {stream: {setting: value}}}, [problem, ...]): settings that are none are left out
    """
    good, problems = {}, []
    for profile in profiles.values():
        good[profile.name] = {}
        for name, stream in streams.items():
            table, values = live(stream.PARAMETERS), {}
            for setting, value in profile.of(name).items():
                try:
                    values[setting] = check_one(setting, value, table)
                except ValueError as error:
                    problems.append("profile %r, stream '%s': %s" % (profile.name, name, error))
            good[profile.name][name] = values
    return good, problems


class FocusControl:
    """Holds the focus and each stream's live settings.

    :param streams: {name: RobotStream}, started
    :param profiles: {name: supervisor.focus.Profile}
    :param allocation: allocation.Allocation of the streams
    :param tell: f(problem), told what is refused
    """

    def __init__(self, streams, profiles, allocation, tell):
        self._streams, self._allocation, self._tell_problem = streams, allocation, tell
        profiles = {AS_CONFIGURED: Profile(AS_CONFIGURED, 'As streams.yaml has it.'), **profiles}
        self._profiles, problems = valid_profiles(profiles, streams)
        for problem in problems:
            tell(problem)
        self._lock = threading.RLock()     # one for all: a switch changes many parts
        self._modified, self._switching = set(), False
        self._request, self._refusal = 0, ''
        self._configured = {name: {key: stream.asked[key] for key in live(stream.PARAMETERS)}
                            for name, stream in streams.items()}
        self._status = rospy.Publisher('~status', RobotStatus, queue_size=1, latch=True)
        self._modified_topic = rospy.Publisher('~focus/modified', Bool, queue_size=1, latch=True)
        self._show = Repeater('settings', self._show_all, lambda error: rospy.logerr('settings: %s', error), None)
        focus = {'focus': Parameter(AS_CONFIGURED, '', 'the mission focus', choices=tuple(self._profiles))}
        self._focus = LiveSettings('', focus, {'focus': AS_CONFIGURED}, lambda values: self._switch(values['focus']),
                                   self._lock, tell)
        self._parts = {name: LiveSettings(name, live(stream.PARAMETERS), stream.asked,
                                          lambda values, name=name: self._configure(name, values), self._lock, tell)
                       for name, stream in streams.items()}
        # a stream's own parameters count before the focus
        self._watch = ParameterWatch([self._focus, *self._parts.values()], background=False)
        self._show.start()
        self._granted = None        # as the status told it last
        self._grants = Repeater('grants', self._tell_grants, lambda error: rospy.logerr('status: %s', error),
                                GRANTS_TOLD)
        self._grants.start()
        rospy.Service('~set_focus', SetFocus, self._serve)
        self._requests = udpros.Subscriber(REQUESTS, FocusRequest, self._requested, queue_size=5)
        self._tell()

    def set_focus(self, name):
        """Switch to a profile; values set by hand are forgotten, even where it is the focus already.

        :raises ValueError: where there is no such profile
        """
        with self._lock:
            if name == self._focus.values['focus']:
                self._switch(name)
            else:
                self._focus.set({'focus': name})

    def _switch(self, name):
        with self._lock:
            self._switching = True
            for stream, part in self._parts.items():
                try:
                    part.set({**self._configured[stream], **self._profiles[name][stream]})
                except ValueError as error:
                    self._tell_problem("profile %r, stream '%s' stays as it is: %s" % (name, stream, error))
            self._switching = False
            self._modified.clear()
        self._allocation.forget()
        rospy.loginfo('focus: %s', name)
        self._show.wake()

    def _configure(self, name, values):
        """Apply one stream's settings; ValueError refuses them."""
        self._streams[name].configure(values)
        if not self._switching:
            self._modified.add(name)
            self._show.wake()

    def _show_all(self):
        self._tell()
        for part in [self._focus, *self._parts.values()]:
            part.show()

    def _serve(self, request):
        try:
            self.set_focus(request.focus)
        except ValueError as error:
            self._tell_problem('~set_focus: %s' % error)
            return SetFocusResponse(False, str(error))
        self._tell()
        return SetFocusResponse(True, 'the focus is ' + request.focus)

    def _requested(self, request):
        """The operator's request; it comes again until the operator has our answer."""
        with self._lock:
            if request.id != self._request:
                self._request, self._refusal = request.id, ''
                try:
                    self.set_focus(request.focus)
                except ValueError as error:
                    self._tell_problem("the operator's request: %s" % error)
                    self._refusal = str(error)
        self._tell()

    def _tell_grants(self):
        """Publish the status where what the link leaves has changed."""
        if self._granted != [(stream.granted, stream.paused) for stream in self._streams.values()]:
            self._tell()

    def _tell(self):
        """Publish the status."""
        self._granted = [(stream.granted, stream.paused) for stream in self._streams.values()]
        with self._lock:
            status = RobotStatus(focus=self._focus.values['focus'], modified=bool(self._modified),
                                 profiles=list(self._profiles), request=self._request, refusal=self._refusal)
            status.header.stamp = rospy.Time.now()
            for name, part in self._parts.items():
                values = dict(part.values)
                status.streams.append(StreamStatus(
                    name=name, type=self._streams[name].asked['type'], modified=name in self._modified,
                    share=self._allocation.shares.get(name, 0.0) / KBIT, waits=self._streams[name].paused,
                    granted=_told(self._streams[name].granted),
                    **{key: values.pop(key) for key in ('enabled', 'rate', 'weight', 'floor')},
                    quality=_told({key: value for key, value in values.items()
                                   if value != part.table[key].default})))
        self._status.publish(status)
        self._modified_topic.publish(status.modified)

    def close(self):
        self._requests.unregister()
        self._watch.stop()
        self._show.stop()
        self._grants.stop()


def _told(settings):
    return ', '.join('%s: %s' % (key, '%.3g' % value if isinstance(value, float) else value)
                     for key, value in settings.items())
