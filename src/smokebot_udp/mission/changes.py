# SPDX-License-Identifier: BSD-3-Clause
"""What a switch of the focus has changed, in words, by the StreamStatus messages before and after."""
from typing import Any, Dict, List, Mapping, Sequence

UNITS = {'rate': ' Hz', 'min_bitrate': ' kbit/s', 'leaf_size': ' m', 'repeat_rate': ' Hz'}


def answer(focus: str, before: Sequence[Any], after: Sequence[Any]) -> str:
    """The answer to who has switched the focus.

    :param before, after: [StreamStatus, ...]
    """
    known = {stream.name: stream for stream in before}
    changed = [_stream_changes(known[stream.name], stream) for stream in after if stream.name in known]
    return 'the focus is %s: %s' % (focus, '; '.join(filter(None, changed)) or 'nothing has changed')


def _stream_changes(before: Any, after: Any) -> str:
    """What has changed of one stream; empty: nothing."""
    if not after.enabled:
        return after.name + ' off' if before.enabled else ''
    old, new = _settings(before), _settings(after)
    words: List[str] = [] if before.enabled else ['on']
    words += [_change(name, old, new) for name in {**old, **new} if old.get(name) != new.get(name)]
    return '%s %s' % (after.name, ', '.join(words)) if words else ''


def _settings(stream: Any) -> Dict[str, Any]:
    """{setting: value}, of the others only those that differ from streams.yaml."""
    found = {name: getattr(stream, name) for name in ('rate', 'weight', 'min_bitrate')}
    found.update((one.name, one.value) for one in (*stream.bools, *stream.doubles, *stream.strs))
    return found


def _change(name: str, old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    if name not in new:
        return name + ' as in streams.yaml'
    before = '%s -> ' % _text(old[name]) if name in old else ''
    return '%s %s%s%s' % (name, before, _text(new[name]), UNITS.get(name, ''))


def _text(value: Any) -> str:
    return '%g' % value if isinstance(value, float) else str(value)
