# SPDX-License-Identifier: BSD-3-Clause
"""Makes a page of the bags that the black boxes of a mission have recorded.

    rosrun smokebot_udp mission_report ROBOT.bag [...] OPERATOR.bag [...] [-o report.html]

The bags may be given in any order, or as folders. Those that were not closed (.active) are read, too. It is not a node.
"""
import argparse
import functools
import os
import pathlib
import sys
from typing import Any, Dict, Iterable, List, Mapping, Optional, Sequence, Tuple

import rospkg

from .. import optional
from ..streams import config
from ..streams.recorded_topics import recorded_streams
from . import bags, film_strip, page, plots
from .mission import Mission
from .record import SIDES, Description, MissionRecord, Stream

PATTERNS = '*.bag', '*.bag.active'
"""Patterns of the names of bags in a folder."""


class Failure(Exception):
    """Why there is no report, in words."""


def main(arguments: Optional[Sequence[str]] = None) -> int:
    """The exit code."""
    parser = argparse.ArgumentParser(prog='mission_report', description='Makes a page of the bags of a mission.')
    parser.add_argument('bags', nargs='+', metavar='BAG', help='bags of the robot, of the operator, or folders of them')
    parser.add_argument('-o', '--output', default='report.html', help='default: report.html')
    parser.add_argument('--streams', default='', help='streams.yaml of bags that the black box has not recorded; '
                        "default: this package's")
    parser.add_argument('--moments', type=int, default=8, help='images of the film strip, those of events aside; '
                        'default: 8')
    options = parser.parse_args(arguments)
    try:
        _report(options)
    except Failure as error:
        print('mission_report: %s' % error, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0


def _report(options: Any) -> None:
    """:raises Failure: where there is no report"""
    opened, problems = bags.open_bags(_paths(options.bags))
    for problem in problems:
        print('mission_report: %s' % problem, file=sys.stderr)
    if not opened:
        raise Failure('no bag can be used')
    used, descriptions = _described(opened, options.streams, problems)
    record = MissionRecord()
    for number, (bag, description) in enumerate(zip(used, descriptions)):
        record.describe(description)
        print('reading %s (%s)' % (bag.path, description.side))
        try:
            bag.read(record, description.roles, description.side, number)
        except bags.BadBag as error:
            print('mission_report: %s' % error, file=sys.stderr)
            problems.append(str(error))
    if not record.spans:
        raise Failure('no message can be read')
    try:
        mission = Mission(record)
    except ValueError as error:
        raise Failure(str(error)) from None
    strip = film_strip.moments(mission, used, options.moments)
    drawn = _plots(mission, problems)
    text = page.page(mission, drawn, strip, problems)
    try:
        pathlib.Path(options.output).write_text(text)
    except OSError as error:
        raise Failure('%s cannot be written: %s' % (options.output, error.strerror)) from None
    print('the report is in %s' % os.path.abspath(options.output))


def _plots(mission: Mission, problems: List[str]) -> List[page.Picture]:
    problem = optional.attempt('matplotlib.figure').problem
    if problem:
        problem = 'there are no plots: %s (python3-matplotlib)' % problem
        print('mission_report: %s' % problem, file=sys.stderr)
        problems.append(problem)
        return []
    return plots.draw(mission)


def _paths(given: Sequence[str]) -> List[pathlib.Path]:
    """All bags, those of folders too, each once.

    :raises Failure: where a folder has none
    """
    found: Dict[pathlib.Path, None] = {}
    for path in map(pathlib.Path, given):
        if path.is_dir():
            inside = sorted(one for pattern in PATTERNS for one in path.glob(pattern))
            if not inside:
                raise Failure('%s has no bags' % path)
            found.update(dict.fromkeys(inside))
        else:
            found[path] = None
    return list(found)


def _described(opened: Sequence[bags.BagFile], streams: str, problems: List[str]
               ) -> Tuple[List[bags.BagFile], List[Description]]:
    """The bags whose side is known, and what they are; problems gets the others.

    :param streams: path of a streams.yaml; empty: this package's
    :raises Failure: where none is left, or they are not of one mission
    """
    used, descriptions = [], []
    for bag in opened:
        description = bag.description
        if description is None:
            loaded = _load(streams)
            description = described(bag.topics, *loaded)
        if description is None:
            problem = '%s is of neither side: it has no topic of a stream (--streams FILE names the streams)' % bag.path
            print('mission_report: %s' % problem, file=sys.stderr)
            problems.append(problem)
            continue
        used.append(bag)
        descriptions.append(description)
    if not used:
        raise Failure('no bag can be used')
    problem = contradiction(descriptions)
    if problem:
        raise Failure(problem)
    return used, descriptions


def _load(path: str) -> Tuple[Dict[str, Stream], Dict[str, Dict[str, List[str]]]]:
    """({name: Stream}, {side: {name: topics}}) of a streams.yaml.

    :raises Failure: where it cannot be read
    """
    path = path or os.path.join(rospkg.RosPack().get_path('smokebot_udp'), 'config', 'streams.yaml')
    try:
        definitions, problems = config.load(pathlib.Path(path).read_text())
    except (OSError, UnicodeDecodeError) as error:
        raise Failure('%s cannot be read: %s' % (path, error)) from None
    if not definitions:
        raise Failure('%s: %s' % (path, '; '.join(problems) or 'it has no streams'))
    resolved = {side: recorded_streams(definitions, side, functools.partial(_resolve, side)) for side in SIDES}
    return ({name: Stream(one.type, one.to_robot) for name, one in resolved['robot'].items()},
            {side: {name: one.topics for name, one in found.items()} for side, found in resolved.items()})


def _resolve(side: str, name: str) -> str:
    """A topic's full name, without a namespace."""
    node = '/robot_sender/' if side == 'robot' else '/operator_receiver/'
    return node + name[1:] if name.startswith('~') else '/' + name.lstrip('/')


def described(topics: Iterable[str], streams: Mapping[str, Stream], names: Mapping[str, Mapping[str, List[str]]]
              ) -> Optional[Description]:
    """What can be said of a bag that the black box has not recorded; None: it has no topic of a stream.

    :param topics: of the bag
    :param streams: of a streams.yaml
    :param names: {side: {stream: its topics there}}; those of the operator's side may be in a namespace
    """
    topics = list(topics)
    roles: Dict[str, List[Tuple[str, str]]] = {}
    for side in SIDES:
        for name, expected in names[side].items():
            for topic in topics:
                if any(topic == one or (side == 'operator' and topic.endswith(one)) for one in expected):
                    roles.setdefault(topic, []).append((side, name))
    counts = {side: sum(side in {one for one, _ in found} for found in roles.values()) for side in SIDES}
    if not roles:
        return None
    return Description(max(SIDES, key=lambda side: counts[side]), '/', dict(streams), roles)


def contradiction(descriptions: Iterable[Description]) -> str:
    """Why these are not bags of one mission, in words; empty: they may be."""
    found = sorted({one.namespace for one in descriptions if one.side == 'operator'})
    if len(found) > 1:
        return 'the bags are of several operators, %s: give those of one' % ', '.join(
            name.strip('/') or 'one without a name' for name in found)
    return ''
