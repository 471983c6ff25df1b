# SPDX-License-Identifier: BSD-3-Clause
"""What `check` finds wrong with a streams.yaml and what the robot publishes, before the mission."""
from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from ..long_messages import REMEDY, datagrams
from .sources import SERVICE, Graph, Source, problem_of
from .status import ERROR, LEVELS, OK, WARN

MAX_OFFSET = 1.0
"""Maximum difference between stamps and this machine's clock. Beyond it, ages are wrong and commands refused [s]."""

PLACED = {'cloud', 'scan', 'virtual_scan', 'grid'}
"""Types that rviz draws in the frame of their messages."""

OWN_TOPICS = '/robot_sender/', '/diagnostics'
"""Beginnings of the topics that robot_sender publishes itself; before a mission it need not run yet."""

COLUMNS = (('STREAM', 18), ('TYPE', 12), ('ROLE', 15), ('Hz', 6), ('SENT', 6), ('kB', 8), ('AGE ms', 8),
           ('kbit/s, least', 13), ('most', 8))
"""(heading, minimum width). Rates and sizes are the source's; `SENT` is the maximum rate; what a stream takes of the
link at least and at most is by its operating points."""


class Finding(NamedTuple):
    """Something that is wrong."""
    level: int
    subject: str
    text: str


class Heard(NamedTuple):
    """What came from a source while it was listened to."""
    rate: float = 0.0
    """[Hz]; 0: nothing came."""
    size: float = 0.0
    """Mean size of a message [byte]."""
    age: Optional[float] = None
    """Median time from the stamp to the arrival; None: there is no stamp [s]."""
    frame: Optional[str] = None
    """frame_id; None: messages of this type have none."""
    stamped: bool = False
    """Whether messages of this type have a header."""


class Cost(NamedTuple):
    """What a stream takes of the link [kbit/s]."""
    least: float
    most: float


class Checked(NamedTuple):
    """One stream, and what is known of its source."""
    name: str
    settings: Mapping[str, Any]
    source: Source
    steady: bool
    """Whether a silent source is a fault."""
    heard: Heard = Heard()
    cost: Optional[Cost] = None
    failure: str = ''
    """Why a message of it cannot be sent."""


def judge(stream: Checked, graph: Graph, missing_frames: Sequence[str]) -> List[Finding]:
    """What is wrong with a stream.

    :param missing_frames: that tf cannot transform into the fixed frame
    """
    problems = _of_source(stream, graph) + ([(ERROR, 'a message cannot be sent: ' + stream.failure)]
                                            if stream.failure else [])
    if stream.heard.rate:
        problems += _of_messages(stream, missing_frames)
    return [Finding(level, stream.name, text) for level, text in problems]


def _of_source(stream: Checked, graph: Graph) -> List[Tuple[int, str]]:
    """What is wrong with the source of a stream."""
    heard = bool(stream.heard.rate)
    if is_own(stream.source) and not graph.publishers.get(stream.source.name):
        return []
    problem = problem_of(stream.source, graph, stream.steady and not heard)
    return [(ERROR if stream.steady or heard else WARN, problem)] if problem else []


def is_own(source: Source) -> bool:
    """Whether robot_sender publishes it."""
    return source.name.startswith(OWN_TOPICS)


def _of_messages(stream: Checked, missing_frames: Sequence[str]) -> List[Tuple[int, str]]:
    """What is wrong with the messages of a source. Latched ones may be old."""
    heard, settings, found = stream.heard, stream.settings, []
    if stream.steady and heard.age is not None and abs(heard.age) > MAX_OFFSET:
        found.append("its stamps are %.1f s %s this machine's clock" % (
            abs(heard.age), 'behind' if heard.age > 0 else 'ahead of'))
    if heard.stamped and heard.age is None:
        found.append('its messages have no stamp: their age counts from their arrival at robot_sender')
    if settings['type'] in PLACED and not heard.frame:
        found.append('its messages have no frame_id: rviz cannot place them')
    elif settings['type'] in PLACED and heard.frame in missing_frames:
        found.append('tf knows no way from its frame %r to the fixed frame: rviz cannot place it' % heard.frame)
    if settings['type'] == 'relay' and not settings['reliable'] and datagrams(heard.size) > 1 and not is_own(
            stream.source):
        found.append('its messages take %d datagrams each, and are lost with any of them; %s' % (
            datagrams(heard.size), REMEDY))
    return [(WARN, text) for text in found]


def judge_link(streams: Sequence[Checked], link: Optional[float]) -> List[Finding]:
    """Whether the link carries the streams.

    :param link: its capacity; None: unknown [kbit/s]
    """
    known = [(stream, stream.cost) for stream in streams if stream.cost is not None]
    least = sum(cost.least for _, cost in known)
    text = 'the streams take %s at least' % rate_text(least)
    if link is None:
        return [Finding(OK, 'link', text + ', and more makes images sharper; give its capacity by --link MBIT')]
    text += ', it carries ' + rate_text(link)
    if least > link:
        return [Finding(ERROR, 'link', text + ': remove streams, or lower their rates')]
    images = [cost.least for stream, cost in known if stream.settings['type'] == 'image']
    return [Finding(OK, 'link', '%s: images share %s of it' % (
        text, rate_text(link - least + sum(images))) if images else text)]


def judge_buffer(allowed: int, wanted: int) -> List[Finding]:
    """Whether the kernel grants the receive buffer [byte]."""
    if allowed >= wanted:
        return []
    return [Finding(WARN, 'receive buffer', 'net.core.rmem_max is %d, %d are wanted at the desk: bursts are dropped; '
                    'sudo sysctl -w net.core.rmem_max=%d' % (allowed, wanted, 2 * wanted))]


def judge_service_type(name: str, found: Optional[str], expected: str) -> List[Finding]:
    """Whether a service has the right type.

    :param found: None: it does not answer
    """
    if found is None:
        return [Finding(ERROR, name, 'its service does not answer')]
    return [] if found == expected else [Finding(ERROR, name, 'its service is %s, must be %s' % (found, expected))]


def is_there(source: Source, graph: Graph) -> bool:
    """Whether a source is a service that the robot has."""
    return source.kind == SERVICE and source.name in graph.services


def table(streams: Sequence[Checked], roles: Mapping[str, str]) -> List[str]:
    """The lines of the table of all streams."""
    rows = [[heading for heading, _ in COLUMNS]]
    for stream in streams:
        heard, cost = stream.heard, stream.cost
        rows.append([
            stream.name, stream.settings['type'], roles.get(stream.name, '') or '-',
            '%.3g' % heard.rate if heard.rate else '-',
            '%.3g' % min(stream.settings['rate'], heard.rate) if 'rate' in stream.settings and heard.rate else '-',
            '%.3g' % (heard.size / 1e3) if heard.rate else '-',
            '-' if heard.age is None else '%.0f' % (1e3 * heard.age),
            '-' if cost is None else '%.3g' % cost.least if cost.least < 1000 else '%.0f' % cost.least,
            '-' if cost is None else '%.3g' % cost.most if cost.most < 1000 else '%.0f' % cost.most])
    widths = [max(width, *map(len, cells)) for (_, width), cells in zip(COLUMNS, zip(*rows))]
    return [' '.join('%-*s' % (width, cell) if number < 3 else '%*s' % (width, cell)
                     for number, (width, cell) in enumerate(zip(widths, row))).rstrip() for row in rows]


def lines(findings: Sequence[Finding]) -> List[str]:
    """What is wrong, the worst first, and how much of it there is."""
    counts: Dict[int, int] = {level: sum(finding.level == level for finding in findings) for level in LEVELS}
    shown = ['%-6s %s: %s' % (LEVELS[finding.level], finding.subject, finding.text)
             for finding in sorted(findings, key=lambda finding: -finding.level)]
    return shown + ['errors: %d, warnings: %d' % (counts[ERROR], counts[WARN])]


def rate_text(kbits: float) -> str:
    """A rate in a readable unit.

    :param kbits: [kbit/s]
    """
    return '%.3g Mbit/s' % (kbits / 1e3) if kbits >= 1000 else '%.3g kbit/s' % kbits
