# SPDX-License-Identifier: BSD-3-Clause
"""The settings of one stream: requested by the user, granted by the link controller, and in effect."""
import threading
from dataclasses import dataclass, field
from typing import Any, Callable, Dict, Iterator, Mapping, Optional

from .parameters import Table, check_one


@dataclass(frozen=True)
class Settings(Mapping[str, Any]):
    """The settings at one moment; as a mapping, those in effect. Immutable."""
    requested: Mapping[str, Any]
    """By streams.yaml, the mission focus and live changes."""
    granted: Optional[Mapping[str, Any]] = field(default_factory=dict)
    """Values in effect in place of requested ones, because of the link; None: the link has no room, the stream is
    paused."""

    def __getitem__(self, name: str) -> Any:
        granted = self.granted or {}
        return granted[name] if name in granted else self.requested[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.requested)

    def __len__(self) -> int:
        return len(self.requested)

    @property
    def paused(self) -> bool:
        """Whether the link has no room for the stream."""
        return self.granted is None


class SettingsStore:
    """Holds a stream's settings. Any thread may read and change them; listeners run in the thread that changes.

    :param table: {name: Parameter} of the settings that may be requested while the stream runs
    :param requested: {name: value} at the start, each checked already; names that the table lacks never change
    :param check: f(requested), raises ValueError where values contradict each other
    :raises ValueError: from ``check``
    """

    def __init__(self, table: Table, requested: Mapping[str, Any],
                 check: Callable[[Mapping[str, Any]], None] = lambda requested: None) -> None:
        check(requested)
        self.table = dict(table)
        self._check = check
        self._lock = threading.RLock()
        self._current = Settings(dict(requested))
        self._listeners: Dict[Callable[[Settings, Mapping[str, Any]], None], None] = {}

    @property
    def current(self) -> Settings:
        """The settings now."""
        return self._current

    def subscribe(self, listener: Callable[[Settings, Mapping[str, Any]], None]) -> None:
        """Call ``listener(settings, changed)`` after each change.

        :param listener: called under the store's lock, so it must not wait for another thread that changes settings;
            changed: {name: value} of the settings whose value in effect differs from before
        """
        self._listeners[listener] = None

    def request(self, changes: Mapping[str, Any]) -> Dict[str, Any]:
        """Request other values. A changed setting loses its grant; all other grants stand.

        :param changes: {name: value}; values that are requested already are no change
        :return: {name: value} that changed
        :raises ValueError: naming the setting and its value; nothing is changed then
        """
        with self._lock:
            before = self._current
            checked = {name: check_one(name, value, self.table) for name, value in changes.items()}
            delta = {name: value for name, value in checked.items() if value != before.requested[name]}
            if delta:
                requested = {**before.requested, **delta}
                self._check(requested)
                granted = before.granted
                if granted is not None:
                    granted = {name: value for name, value in granted.items() if name not in delta}
                self._set(Settings(requested, granted))
            return delta

    def grant(self, limits: Optional[Mapping[str, Any]]) -> None:
        """Limit the requested settings to the link's capacity. It replaces the grant before.

        :param limits: {name: value} in place of requested ones; None: the stream is paused
        """
        with self._lock:
            if limits != self._current.granted:
                self._set(Settings(self._current.requested, None if limits is None else dict(limits)))

    def _set(self, settings: Settings) -> None:
        before, self._current = self._current, settings
        changed = {name: settings[name] for name in settings if settings[name] != before[name]}
        for listener in list(self._listeners):
            listener(settings, changed)
