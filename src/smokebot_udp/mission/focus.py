# SPDX-License-Identifier: BSD-3-Clause
"""The mission focus: profiles of what each stream is to send (D6.3, sections 1 and 3).

A profile names settings of streams; what it does not name stays as streams.yaml has it. Of a profile that
extends another, each setting it names counts before the other's.
"""
from dataclasses import dataclass, field
from typing import Any, Dict

import yaml


@dataclass(frozen=True)
class Profile:
    """One focus."""
    name: str
    use: str
    """When to use it, in a sentence."""
    streams: Dict[str, Dict[str, Any]] = field(default_factory=dict)
    """{stream: {setting: value}}"""
    others: Dict[str, Any] = field(default_factory=dict)
    """{setting: value} of the streams that are not named."""

    def of(self, stream):
        """{setting: value} that it names for a stream."""
        return self.streams.get(stream, self.others)


def load(text):
    """Read the text of a focus.yaml.

    :return: ({name: Profile} of the good profiles, [problem, ...] in words)
    """
    try:
        document = yaml.safe_load(text)
    except yaml.YAMLError as error:
        return {}, ['it is no YAML: %s' % ' '.join(str(error).split())]
    written = document.get('profiles') if isinstance(document, dict) else None
    if not isinstance(written, dict):
        return {}, ['it has no "profiles:" with the profiles by name']
    good, problems = {}, []
    for name in written:
        try:
            good[name] = _profile(name, written, ())
        except ValueError as error:
            problems.append('profile %r: %s' % (name, error))
    return good, problems


def _profile(name, written, heirs):
    """The profile of this name with all that it extends.

    :param heirs: the profiles that extend it, to find a circle
    """
    if not isinstance(name, str) or not name:
        raise ValueError('its name is no text')
    values = written[name]
    if not isinstance(values, dict) or not set(values) <= {'use', 'extends', 'streams', 'others'}:
        raise ValueError('it has to have use, extends, streams and others, not %r' % (values,))
    streams, others = values.get('streams') or {}, values.get('others') or {}
    for what in (streams, others, *(streams.values() if isinstance(streams, dict) else ())):
        if not isinstance(what, dict):
            raise ValueError('%r is no settings with values' % (what,))
    base = values.get('extends')
    if base is None:
        return Profile(name, str(values.get('use', '')), streams, others)
    if base not in written:
        raise ValueError('it extends %r, which is not there' % (base,))
    if base == name or base in heirs:
        raise ValueError('it extends itself, by way of %r' % (base,))
    basis = _profile(base, written, heirs + (name,))
    # what the basis says of all others goes for a stream that only this one names, too
    merged = {stream: {**basis.of(stream), **streams.get(stream, others)} for stream in {*basis.streams, *streams}}
    return Profile(name, str(values.get('use', basis.use)), merged, {**basis.others, **others})
