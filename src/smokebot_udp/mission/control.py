# SPDX-License-Identifier: BSD-3-Clause
"""The robot's mission focus and the requested settings of its streams.

A switch of the focus requests the profile's settings of each stream, and those of streams.yaml that it does not name.
Settings that are requested otherwise, by hand, stand until the next switch.
"""
import threading
from dataclasses import dataclass, replace
from typing import Any, Callable, Dict, FrozenSet, List, Mapping, Optional, Set

from .focus import Profile, missing_streams, settings_of
from .parameters import STATUS_TYPES, Parameter
from .remote import FOCUS_PART, FOCUS_SETTING
from .settings import Settings, SettingsStore

AS_CONFIGURED = 'default'
"""Name of the profile that has all as in streams.yaml."""

FOCUS = Parameter(AS_CONFIGURED, '', 'the mission focus: a profile of focus_file; default: all as in streams.yaml',
                  live=True)


@dataclass(frozen=True)
class State:
    """All at one moment."""
    focus: str
    modified: FrozenSet[str]
    """The streams with settings changed by hand since the last switch of the focus."""
    streams: Mapping[str, Settings]


class MissionControl:
    """Holds the focus; all requests for settings go through it. Any thread may call it.

    :param streams: {name: SettingsStore}, with the settings of streams.yaml; only this class requests settings of them
    :param profiles: {name: Profile}
    :param report: f(problem), called with what is refused
    :param switched: f(focus), called after each switch
    :param changed: f(), called after any change
    """

    def __init__(self, streams: Mapping[str, SettingsStore], profiles: Mapping[str, Profile],
                 report: Callable[[str], None], switched: Callable[[str], None], changed: Callable[[], None]) -> None:
        self._streams, self._report, self._switched, self._changed = streams, report, switched, changed
        profiles = {AS_CONFIGURED: Profile(AS_CONFIGURED, 'As in streams.yaml.'), **profiles}
        configured = {name: store.current.requested for name, store in streams.items()}
        self.warnings = missing_streams(profiles, streams)
        """What was read but has no effect, in words."""
        self._own = {name for name, settings in configured.items() if settings.get('message_type') in STATUS_TYPES}
        self._settings, problems = settings_of(
            profiles, {name: store.table for name, store in streams.items()}, configured)
        for problem in problems:
            report(problem)
        self._configured = {name: {setting: configured[name][setting] for setting in store.table}
                            for name, store in streams.items()}
        self._lock = threading.RLock()     # taken before a store's
        self.focus_store = SettingsStore(
            {'focus': replace(FOCUS, choices=tuple(self._settings))}, {'focus': AS_CONFIGURED})
        """The focus as a setting; only `request_focus` and `switch` change it."""
        self._modified: Set[str] = set()

    @property
    def profiles(self) -> List[str]:
        """The names of the profiles."""
        return list(self._settings)

    def warning(self, focus: str) -> Optional[str]:
        """The warning that a focus deserves: its profile has settings only for streams and roles that do not exist, or
        for this package's own. None: there is none."""
        if focus == AS_CONFIGURED or any(
                settings for name, settings in self._settings[focus].items() if name not in self._own):
            return None
        return 'focus %s: its profile names no stream and no role of streams.yaml, so all stay as configured' % focus

    def configured(self, stream: str) -> Mapping[str, Any]:
        """{setting: value} of streams.yaml, of those that may change."""
        return self._configured[stream]

    def state(self) -> State:
        """The focus and the streams' settings now."""
        with self._lock:
            return State(self.focus_store.current['focus'], frozenset(self._modified),
                         {name: store.current for name, store in self._streams.items()})

    def request(self, stream: str, changes: Mapping[str, Any]) -> Dict[str, Any]:
        """Change a stream's settings by hand, see SettingsStore.request."""
        with self._lock:
            delta = self._streams[stream].request(changes)
            if delta:
                self._modified.add(stream)
        if delta:
            self._changed()
        return delta

    def request_focus(self, changes: Mapping[str, Any]) -> Dict[str, Any]:
        """Switch the focus where it differs: {'focus': name}, see SettingsStore.request."""
        with self._lock:
            delta = self.focus_store.request(changes)
            if delta:
                self._apply()
        return delta

    def parts(self) -> Dict[str, Mapping[str, Any]]:
        """{part: {setting: requested value}} of all settings that may change, see mission/remote.py."""
        with self._lock:
            return {name: {setting: store.current.requested[setting] for setting in store.table}
                    for name, store in ((FOCUS_PART, self.focus_store), *self._streams.items())}

    def request_part(self, part: str, changes: Mapping[str, Any]) -> None:
        """Change the settings of a part by hand. A request for the focus resets settings that were changed by hand,
        even where it is the focus already.

        :raises ValueError: where they are refused, see SettingsStore.request
        """
        if part != FOCUS_PART:
            self.request(part, changes)
            return
        with self._lock:
            self.focus_store.request(changes)
            self._apply()

    def switch(self, focus: str) -> None:
        """Switch the focus, see `request_part`."""
        self.request_part(FOCUS_PART, {FOCUS_SETTING: focus})

    def _apply(self) -> None:
        """Request the settings of the focus."""
        focus = self.focus_store.current['focus']
        for name, store in self._streams.items():
            try:
                store.request({**self._configured[name], **self._settings[focus][name]})
            except ValueError as error:
                self._report("profile %r, stream '%s' stays as it is: %s" % (focus, name, error))
        self._modified.clear()
        self._switched(focus)
        self._changed()
