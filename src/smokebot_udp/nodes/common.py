# SPDX-License-Identifier: BSD-3-Clause
"""What the nodes of both sides do alike: read their parameters, and load the streams they name."""
import math
import os

import rospkg
import rospy

from ..streams import config


class Parameters:
    """The node's private parameters, as they are now; asked for all at once: over a bad link each call takes its time.

    :param tell: f(problem), told what is wrong
    """

    def __init__(self, tell=rospy.logerr):
        found = rospy.get_param('~', {})
        self.values = found if isinstance(found, dict) else {}
        self.tell = tell

    def number(self, name, default, least=None, most=None):
        """A number; what is no number in the limits is told of, and the default stands."""
        value = self.values.get(name, default)
        good = isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
        if good and (least is None or value >= least) and (most is None or value <= most):
            return value
        limits = ['from %g' % least] * (least is not None) + ['to %g' % most] * (most is not None)
        self.tell('%s is %r, must be a number %s: %r is used' % (
            rospy.resolve_name('~' + name), value, ' '.join(limits), default))
        return default

    def flag(self, name, default):
        """True or false."""
        value = self.values.get(name, default)
        if isinstance(value, bool):
            return value
        self.tell('%s is %r, must be true or false: %r is used' % (rospy.resolve_name('~' + name), value, default))
        return default

    def text(self, name, default):
        """A text, such as a topic or a file."""
        value = self.values.get(name, default)
        if isinstance(value, str):
            return value
        self.tell('%s is %r, must be a text: %r is used' % (rospy.resolve_name('~' + name), value, default))
        return default


def read_file(parameters, name, default, load):
    """The good parts of the file that a node's parameter names; what is wrong is told of.

    :param parameters: Parameters
    :param name: of the parameter
    :param default: its name in this package's config
    :param load: f(text) -> (good, [problem, ...])
    """
    path = parameters.text(name, '') or os.path.join(
        rospkg.RosPack().get_path('smokebot_udp'), 'config', default)
    try:
        with open(path) as file:
            good, problems = load(file.read())
    except (OSError, UnicodeDecodeError) as error:
        good, problems = {}, ['it cannot be read: %s' % error]
    for problem in problems:
        parameters.tell('%s: %s' % (path, problem))
    return good


def read_streams(parameters):
    """The good streams of the node's ~streams_file: {name: settings}."""
    return read_file(parameters, 'streams_file', 'streams.yaml', config.load)


def load_streams(parameters, class_of, link):
    """Start each stream of the node's ~streams_file; one that cannot start leaves the others running.

    :param parameters: Parameters
    :param class_of: streams.robot_class or streams.operator_class
    :return: {name: stream}
    """
    streams = {}
    for name, settings in read_streams(parameters).items():
        try:
            stream = class_of(settings['type'])(name, settings, link)
            stream.start()
            streams[name] = stream
        except Exception as error:
            parameters.tell("stream '%s' (%s) does not start: %s" % (name, settings['type'], error))
    return streams
