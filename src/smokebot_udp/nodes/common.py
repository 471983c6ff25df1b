# SPDX-License-Identifier: BSD-3-Clause
"""Common to the nodes of both sides: they read their parameters, and load the streams of streams.yaml."""
import functools
import os
from typing import Any, Callable, Dict, List, Mapping, Tuple, TypeVar

import rospkg
import rospy

from ..mission.parameters import Table
from ..streams import config
from ..udpros import rpc

Good = TypeVar('Good', bound=Mapping[str, Any])

Load = Callable[[str, Callable[[str], None]], Tuple[Good, List[str]]]
"""f(text, warn) -> ({name: valid entry}, [problem, ...])"""


def operator_topic(name: str) -> str:
    """The resolved name of a topic of the operator's side: also an absolute one is in the node's namespace.

    All operators use the same streams.yaml; their namespaces keep their topics apart.
    """
    return str(rospy.resolve_name(name.lstrip('/')))


class Parameters:
    """The node's private parameters as they were at the start; all are read in one call of the master.

    :param table: {name: Parameter}
    :param report: f(problem), called with what is wrong
    """

    def __init__(self, table: Table, report: Callable[[str], None] = rospy.logerr) -> None:
        found = rpc.repeated(lambda: rospy.get_param('~', {}))
        self.table, self.report = table, report
        self.values: Dict[str, Any] = found if isinstance(found, dict) else {}
        self.refused: Dict[str, str] = {}
        """{stream: why it does not run}"""

    def __getitem__(self, name: str) -> Any:
        """A parameter's value in its type; a wrong one is reported, and the default is used. A list is a text, too."""
        parameter = self.table[name]
        value = self.values.get(name, parameter.default)
        if parameter.kind is str and isinstance(value, list):
            value = str(value)
        if parameter.kind is int and isinstance(value, float) and value.is_integer():
            value = int(value)
        try:
            return parameter.check(value)
        except ValueError as error:
            self.report('%s is %r, %s: %r is used' % (rospy.resolve_name('~' + name), value, error, parameter.default))
            return parameter.default

    def fill_in(self, values: Mapping[str, Any]) -> None:
        """Give parameters that are empty a value."""
        self.values.update({name: value for name, value in values.items() if not self[name]})


def read_file(parameters: Parameters, name: str, default: str, load: Load[Good]) -> Good:
    """The good parts of the file that a node's parameter names; what is wrong is reported.

    :param name: of the parameter
    :param default: file in this package's config where the parameter is empty
    """
    path = parameters[name] or os.path.join(rospkg.RosPack().get_path('smokebot_udp'), 'config', default)
    try:
        with open(path) as file:
            good, problems = load(file.read(), lambda warning: rospy.logwarn('%s: %s', path, warning))
    except (OSError, UnicodeDecodeError) as error:
        good, problems = load('', lambda warning: None)[0], ['it cannot be read: %s' % error]
    for problem in problems:
        parameters.report('%s: %s' % (path, problem))
    return good


def read_streams(parameters: Parameters) -> config.Streams:
    """The good streams of the node's ~streams_file.

    It imports what they need, which takes most of a node's start: call it before a transport tells others to come.
    """
    return read_file(parameters, 'streams_file', 'streams.yaml', functools.partial(
        config.load, refuse=parameters.refused.__setitem__))


def start_streams(definitions: Mapping[str, Dict[str, Any]], make_stream: Callable[[str, Dict[str, Any]], Any],
                  report: Callable[[str], None], refuse: Callable[[str, str], None]) -> Dict[str, Any]:
    """Start each stream; if one cannot start, the others still do.

    :param definitions: as of read_streams
    :param make_stream: f(name, settings) -> stream with start()
    :param report: f(problem)
    :param refuse: f(name, why), called with each stream that does not start
    :return: {name: stream}
    """
    streams = {}
    for name, settings in definitions.items():
        stream = None
        try:
            stream = make_stream(name, settings)
            stream.start()
            streams[name] = stream
        except Exception as error:
            if stream is not None:
                stream.close()      # what it has started already
            report("stream '%s' (%s) does not start: %s" % (name, settings['type'], error))
            refuse(name, 'it does not start: %s' % error)
    return streams
