# SPDX-License-Identifier: BSD-3-Clause
"""The mission focus: profiles of what each stream sends (D6.3, sections 1 and 3).

A profile names settings of streams; all other settings are as in streams.yaml. A profile may extend another one;
its own settings take precedence.
"""
from dataclasses import dataclass, field
from typing import Any, Callable, Collection, Dict, List, Mapping, Tuple

from .parameters import Table, check_one, current_names
from .yaml_text import read_yaml

KEYS = {'use', 'extends', 'streams', 'others'}


@dataclass(frozen=True)
class Profile:
    """One focus."""
    name: str
    use: str
    """When to use it, in a sentence."""
    streams: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """{stream: {setting: value}}"""
    others: Mapping[str, Any] = field(default_factory=dict)
    """{setting: value} of the streams that are not named."""

    def of(self, stream: str) -> Mapping[str, Any]:
        """{setting: value} that it names for a stream."""
        return self.streams.get(stream, self.others)

    def extended(self, heir: 'Profile') -> 'Profile':
        """This profile, overridden by one that extends it."""
        # a stream that only the heir names still inherits this profile's `others`
        streams = {stream: {**self.of(stream), **heir.of(stream)} for stream in {*self.streams, *heir.streams}}
        return Profile(heir.name, heir.use or self.use, streams, {**self.others, **heir.others})


def load(text: str, warn: Callable[[str], None] = lambda warning: None) -> Tuple[Dict[str, Profile], List[str]]:
    """Read the text of a focus.yaml.

    :param warn: called with each warning
    :return: ({name: Profile} of the good profiles, [problem, ...] in words)
    """
    document, invalid = read_yaml(text)
    if document is None and invalid:
        return {}, invalid
    written = document.get('profiles') if isinstance(document, dict) else None
    if not isinstance(written, dict):
        return {}, invalid + ['it has no "profiles:" with the profiles by name']
    alone, problems = {}, {}
    for name, values in written.items():
        try:
            alone[name] = _profile(name, values, warn)
        except ValueError as error:
            problems[name] = str(error)
    good = {}
    for name in alone:
        try:
            good[name] = _with_bases(name, alone, written)
        except ValueError as error:
            problems[name] = str(error)
    return good, invalid + ['profile %r: %s' % (name, problems[name]) for name in written if name in problems]


def _profile(name: Any, values: Any, warn: Callable[[str], None]) -> Profile:
    """A profile as it is in the file, without the profiles that it extends.

    :raises ValueError: where it is not one
    """
    if not isinstance(name, str) or not name:
        raise ValueError('its name is not a text')
    if not isinstance(values, dict) or not set(values) <= KEYS:
        raise ValueError('it must have use, extends, streams and others, not %r' % (values,))
    streams = values.get('streams') or {}
    if not isinstance(streams, dict):
        raise ValueError('streams: %r is not settings by name' % (streams,))

    def settings(where: str, some: Any) -> Dict[str, Any]:
        return _settings(where, some, lambda warning: warn('profile %r, %s' % (name, warning)))
    return Profile(name, str(values.get('use', '')),
                   {stream: settings("stream '%s'" % stream, some) for stream, some in streams.items()},
                   settings('others', values.get('others') or {}))


def _settings(where: str, values: Any, warn: Callable[[str], None]) -> Dict[str, Any]:
    """{setting: value} by today's names.

    :raises ValueError: where it is not that, or has a setting by both names
    """
    if not isinstance(values, dict):
        raise ValueError('%s: %r is not settings by name' % (where, values))
    try:
        settings, warnings = current_names(values)
    except ValueError as error:
        raise ValueError('%s: %s' % (where, error)) from None
    for warning in warnings:
        warn('%s: %s' % (where, warning))
    return settings


def _with_bases(name: str, alone: Mapping[str, Profile], written: Mapping[Any, Any]) -> Profile:
    """A profile with all that it extends.

    :param alone: {name: Profile} as each is written, of the good ones
    :param written: {name: the file's content}
    :raises ValueError: where it extends a profile that is missing or wrong, or itself
    """
    found, heirs = alone[name], [name]
    while written[heirs[-1]].get('extends') is not None:
        base = written[heirs[-1]]['extends']
        if base in heirs:
            raise ValueError('it extends itself, by way of %r' % heirs[-1])
        if base not in list(alone):
            raise ValueError('it extends %r, which %s' % (
                base, 'is wrong' if base in list(written) else 'does not exist'))
        found = alone[base].extended(found)
        heirs.append(base)
    return found


def settings_of(profiles: Mapping[str, Profile], tables: Mapping[str, Table], exempt: Collection[str] = ()
                ) -> Tuple[Dict[str, Dict[str, Dict[str, Any]]], List[str]]:
    """The settings that profiles give to the streams there are.

    :param tables: {stream: {setting: Parameter}} of the settings that may change while it runs
    :param exempt: streams to which `others` does not apply
    :return: ({profile: {stream: {setting: value}}}, [problem, ...]); wrong settings are left out
    """
    found: Dict[str, Dict[str, Dict[str, Any]]] = {name: {stream: {} for stream in tables} for name in profiles}
    problems = []
    for name, profile in profiles.items():
        for stream, table in tables.items():
            given = profile.streams.get(stream, {}) if stream in exempt else profile.of(stream)
            for setting, value in given.items():
                try:
                    found[name][stream][setting] = check_one(setting, value, table)
                except ValueError as error:
                    problems.append("profile %r, stream '%s': %s" % (name, stream, error))
    return found, problems
