# SPDX-License-Identifier: BSD-3-Clause
"""The mission focus: profiles of what each stream sends (D6.3, sections 1 and 3).

A profile names settings of roles, see mission/roles.py, and of streams; all other settings are as in streams.yaml. What
it says of a stream takes precedence. A profile may extend another one; its own settings take precedence.
"""
from dataclasses import dataclass, field, replace
from typing import Any, Dict, Iterable, List, Mapping, NamedTuple, Tuple

from .parameters import Table, check_one, works_in_every_focus
from .roles import COARSER, ROLES, limited, roles_of
from .yaml_text import read_yaml

KEYS = {'use', 'extends', 'roles', 'streams', 'others'}


@dataclass(frozen=True)
class Profile:
    """One focus."""
    name: str
    use: str
    """When to use it, in a sentence."""
    streams: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """{stream: {setting: value}}"""
    others: Mapping[str, Any] = field(default_factory=dict)
    """{setting: value} of the streams that neither are named nor have a role that is."""
    roles: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """{role: {setting: Limit}}"""
    bases: Tuple['Profile', ...] = ()
    """What it extends, the nearest first."""

    def of(self, stream: str, role: str = '', exempt: bool = False) -> Dict[str, Any]:
        """{setting: value or Limit} that it names for a stream.

        :param role: of the stream; empty: none
        :param exempt: whether `others` does not apply to it
        """
        found: Dict[str, Any] = {}
        for profile in (*reversed(self.bases), self):
            if role in profile.roles or stream in profile.streams:
                found.update(profile.roles.get(role, {}))
                found.update(profile.streams.get(stream, {}))
            elif not exempt:
                found.update(profile.others)
        return found


class Limit(NamedTuple):
    """What a profile says of a role. It applies to streams that have the setting."""
    value: Any


def load(text: str) -> Tuple[Dict[str, Profile], List[str]]:
    """Read the text of a focus.yaml.

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
            alone[name] = _profile(name, values)
        except ValueError as error:
            problems[name] = str(error)
    good = {}
    for name in alone:
        try:
            good[name] = _with_bases(name, alone, written)
        except ValueError as error:
            problems[name] = str(error)
    return good, invalid + ['profile %r: %s' % (name, problems[name]) for name in written if name in problems]


def _profile(name: Any, values: Any) -> Profile:
    """A profile as it is in the file, without the profiles that it extends.

    :raises ValueError: where it is not one
    """
    if not isinstance(name, str) or not name:
        raise ValueError('its name is not a text')
    if not isinstance(values, dict) or not set(values) <= KEYS:
        raise ValueError('it must have use, extends, roles, streams and others, not %r' % (values,))
    streams, roles = values.get('streams') or {}, values.get('roles') or {}
    for where, some in ('streams', streams), ('roles', roles):
        if not isinstance(some, dict):
            raise ValueError('%s: %r is not settings by name' % (where, some))
    unknown = [str(role) for role in roles if role not in ROLES]
    if unknown:
        raise ValueError('%s: no such role; there are %s' % (', '.join(unknown), ', '.join(ROLES)))
    return Profile(name, str(values.get('use', '')),
                   {stream: _settings("stream '%s'" % stream, some) for stream, some in streams.items()},
                   _settings('others', values.get('others') or {}),
                   {role: {setting: Limit(value) for setting, value in _settings("role '%s'" % role, some).items()}
                    for role, some in roles.items()})


def _settings(where: str, values: Any) -> Dict[str, Any]:
    """{setting: value}

    :raises ValueError: where it is not that
    """
    if not isinstance(values, dict):
        raise ValueError('%s: %r is not settings by name' % (where, values))
    return values


def _with_bases(name: str, alone: Mapping[str, Profile], written: Mapping[Any, Any]) -> Profile:
    """A profile with all that it extends.

    :param alone: {name: Profile} as each is written, of the good ones
    :param written: {name: the file's content}
    :raises ValueError: where it extends a profile that is missing or wrong, or itself
    """
    heirs = [name]
    while written[heirs[-1]].get('extends') is not None:
        base = written[heirs[-1]]['extends']
        if base in heirs:
            raise ValueError('it extends itself, by way of %r' % heirs[-1])
        if base not in list(alone):
            raise ValueError('it extends %r, which %s' % (
                base, 'is wrong' if base in list(written) else 'does not exist'))
        heirs.append(base)
    profiles = [alone[heir] for heir in heirs]
    return replace(profiles[0], bases=tuple(profiles[1:]),
                   use=next((profile.use for profile in profiles if profile.use), ''))


def settings_of(profiles: Mapping[str, Profile], tables: Mapping[str, Table],
                configured: Mapping[str, Mapping[str, Any]]) -> Tuple[Dict[str, Dict[str, Dict[str, Any]]], List[str]]:
    """The settings that profiles give to the streams there are.

    :param tables: {stream: {setting: Parameter}} of the settings that may change while it runs
    :param configured: {stream: {setting: value}}, as streams.yaml has them
    :return: ({profile: {stream: {setting: value}}}, [problem, ...]); wrong settings are left out
    """
    roles = roles_of(configured)
    found: Dict[str, Dict[str, Dict[str, Any]]] = {name: {stream: {} for stream in tables} for name in profiles}
    problems = _unknown_settings(profiles, {*COARSER, *(setting for table in tables.values() for setting in table)})
    for name, profile in profiles.items():
        for stream, table in tables.items():
            given = profile.of(stream, roles[stream], works_in_every_focus(configured[stream]))
            for setting, value in given.items():
                by_role = isinstance(value, Limit)
                if by_role and setting not in table:
                    continue
                try:
                    checked = check_one(setting, value.value if by_role else value, table)
                    found[name][stream][setting] = limited(
                        setting, checked, configured[stream][setting]) if by_role else checked
                except ValueError as error:
                    problems.append("profile %r, %s: %s" % (
                        name, "role '%s'" % roles[stream] if by_role else "stream '%s'" % stream, error))
    return found, list(dict.fromkeys(problems))


def _unknown_settings(profiles: Mapping[str, Profile], known: Iterable[str]) -> List[str]:
    """What roles are given that no stream has, in words."""
    return ["profile %r, role '%s': %s: no such setting" % (name, role, setting)
            for name, profile in profiles.items() for role, settings in profile.roles.items()
            for setting in settings if setting not in known]


def missing_streams(profiles: Mapping[str, Profile], streams: Mapping[str, Any]) -> List[str]:
    """The warnings that profiles deserve which name streams that do not exist.

    :param streams: those of streams.yaml, by name
    """
    missing = {name: [str(stream) for stream in profile.streams if stream not in streams]
               for name, profile in profiles.items()}
    return ['profile %r: streams.yaml has no stream %s' % (name, ', '.join(streams))
            for name, streams in missing.items() if streams]
