# SPDX-License-Identifier: BSD-3-Clause
"""The page of a mission, one HTML file with all images in it."""
import base64
import html
from typing import Iterable, List, NamedTuple, Optional, Sequence

from . import summary
from .mission import Mission, clock_text
from .record import OPERATOR, ROBOT, SIDES

STYLE = '''
body { max-width: 75em; margin: 2em auto; padding: 0 1em; font: 16px/1.5 sans-serif; color: #222 }
img { max-width: 100% } table { border-collapse: collapse; margin: 1em 0 }
td, th { border: 1px solid #ccc; padding: .2em .6em; text-align: right }
td:first-child, th:first-child, td.text { text-align: left }
h2 { border-top: 1px solid #ccc; padding-top: 1em } p.note { color: #a00 }
figure { display: inline-block; margin: .3em; vertical-align: top } figcaption { font-size: 13px; color: #555 }
h1, h2, h3, td.text, figcaption { overflow-wrap: anywhere }
td { white-space: nowrap }
td.text { white-space: normal }
.strip { display: grid; grid-template-columns: repeat(4, 1fr) } .strip figure { min-width: 0 }
.strip img { width: 100% }
'''

MAX_ROWS = 100
"""Maximum number of rows of a table: of the longest gaps, and of the first events."""


class Picture(NamedTuple):
    """An encoded image and what is written below it."""
    data: bytes
    kind: str
    """Format of the data: png or jpeg."""
    caption: str = ''


class Moment(NamedTuple):
    """Both sides at one time."""
    time: float
    """By the robot's clock [s]."""
    title: str
    pictures: Sequence[Picture]

WHOLE = 0.95
"""A side that recorded this part of the mission recorded all of it."""


def page(mission: Mission, plots: Sequence[Picture], strip: Sequence[Moment], notes: Sequence[str]) -> str:
    """The HTML of the report.

    :param notes: what is wrong with the bags
    """
    begun = clock_text(mission.span[0])
    parts = ['<h1>Mission of %s</h1>' % _text(begun),
             *('<p class="note">%s</p>' % _text(note) for note in [*notes, *_own_notes(mission)]),
             _summary(mission), '<h2>Streams</h2>', _streams(mission)]
    parts += ['<h2>Over time</h2>', *map(_image, plots)] if plots else []
    parts += ['<h2>Times without a new image</h2>', _gaps(mission), '<h2>Events</h2>', _events(mission)]
    if strip:
        parts += ['<h2>Film strip</h2>', '<p>The original on the robot beside what the operator saw.</p>']
        parts += ['<h3>%s: %s</h3>\n<div class="strip">%s</div>' % (
            _time(mission, moment.time), _text(moment.title), ''.join(map(_image, moment.pictures)))
            for moment in strip]
    return ('<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>Mission of %s</title>'
            '<style>%s</style></head>\n<body>\n%s\n</body></html>\n' % (_text(begun), STYLE, '\n'.join(parts)))


def _own_notes(mission: Mission) -> List[str]:
    """What the reader should know of the numbers."""
    notes = ['There is no bag of the %s: what it would show is missing.' % side
             for side in SIDES if side not in mission.spans]
    if OPERATOR in mission.spans and not mission.clock.is_known:
        notes.append("The offset of the robot's clock was not recorded: both clocks are taken for the same.")
    return notes


def _summary(mission: Mission) -> str:
    means, driven = summary.link_means(mission), summary.distance(mission)
    rows = [['duration', _seconds(mission.span[1] - mission.span[0])]]
    rows += [['recorded by the ' + side, '%s to %s' % (_time(mission, begin), _time(mission, end))]
             for side, (begin, end) in mission.spans.items()]
    part = _part(mission)
    rows += [['distance driven' + part, _number(driven, '%.1f m')],
             ['sent, mean', _number(means['sent'], '%.2f Mbit/s')],
             *(['sent by ' + name, '%.1f MB' % total] for name, total in summary.sent_by_path(mission).items()),
             ['capacity, mean', _number(means['capacity'], '%.2f Mbit/s')],
             ['packet loss, mean', _number(means['loss'], '%.1f %%', 100.0)],
             ['queue of the link, mean', _number(means['queue_delay'], '%.0f ms', 1e3)],
             ['round trip, mean', _number(means['round_trip'], '%.0f ms', 1e3)],
             ["the robot's clock minus the operator's", '%.3f s' % mission.clock.median if mission.clock.is_known
              else 'unknown'],
             ['emergency stop engaged' + part, _seconds(sum(one.duration for one in summary.stops(mission)))]]
    for title, found in ('focus', summary.focuses(mission)), ('driver', summary.drivers(mission)):
        total = {one.text: 0.0 for one in found}
        for one in found:
            total[one.text] += one.duration
        rows += [['%s %s%s' % (title, text, part), _seconds(seconds)] for text, seconds in total.items()]
    return _table([], rows)


def _part(mission: Mission) -> str:
    """What follows the names of values that are known only while the robot recorded, where that was not always."""
    if ROBOT not in mission.spans:
        return ''
    begin, end = mission.spans[ROBOT]
    return '' if end - begin >= WHOLE * (mission.span[1] - mission.span[0]) else ', while the robot recorded'


def _streams(mission: Mission) -> str:
    return _table(['stream', 'type', "robot's messages", 'rate', "operator's messages", 'rate', 'median age',
                   '95 % younger than', 'longest gap'], [
        [row.name, row.type, row.counts[ROBOT], _number(row.rates[ROBOT], '%.1f Hz'), row.counts[OPERATOR],
         _number(row.rates[OPERATOR], '%.1f Hz'), _number(row.age, '%.0f ms', 1e3), _number(row.old, '%.0f ms', 1e3),
         _number(row.longest, '%.1f s') if row.longest else '']
        for row in summary.rows(mission)])


def _gaps(mission: Mission) -> str:
    found = summary.all_gaps(mission)
    if not found:
        return '<p>%s</p>' % ('None above 1 s.' if OPERATOR in mission.spans else "Unknown without the operator's bag.")
    return _cut(len(found)) + _table(['stream', 'from', 'to', 'duration', 'cause'], [
        [gap.stream, _time(mission, gap.begin), _time(mission, gap.end), '%.1f s' % gap.duration, gap.cause]
        for gap in found[:MAX_ROWS]], text=4)


def _events(mission: Mission) -> str:
    found = summary.events(mission)
    return _cut(len(found)) + _table(['time', 'event'], [
        [_time(mission, event.time), event.text] for event in found[:MAX_ROWS]], text=1)


def _cut(count: int) -> str:
    return '<p>%d of %d are listed.</p>' % (MAX_ROWS, count) if count > MAX_ROWS else ''


def _table(head: Sequence[str], rows: Iterable[Sequence[object]], text: Optional[int] = None) -> str:
    """A table; column `text` is left-aligned."""
    lines = ['<tr>%s</tr>' % ''.join('<th>%s</th>' % _text(cell) for cell in head)] if head else []
    for row in rows:
        lines.append('<tr>%s</tr>' % ''.join('<td%s>%s</td>' % (' class="text"' * (index == text), _text(cell))
                                             for index, cell in enumerate(row)))
    return '<table>\n%s\n</table>' % '\n'.join(lines)


def _image(picture: Picture) -> str:
    return '<figure><img src="data:image/%s;base64,%s" alt="%s"><figcaption>%s</figcaption></figure>' % (
        picture.kind, base64.b64encode(picture.data).decode(), _text(picture.caption), _text(picture.caption))


def _text(value: object) -> str:
    return html.escape(str(value))


def _number(value: Optional[float], text: str, factor: float = 1.0) -> str:
    return '' if value is None else text % (value * factor)


def _seconds(seconds: float) -> str:
    return '%.1f s' % seconds if seconds < 60 else '%d min %02d s' % divmod(round(seconds), 60)


def _time(mission: Mission, time: float) -> str:
    """A time since the beginning, minutes:seconds."""
    return time_text(time - mission.span[0])


def time_text(seconds: float) -> str:
    """A time since the beginning as minutes:seconds."""
    return '%d:%04.1f' % divmod(round(max(0.0, seconds), 1), 60)
