# SPDX-License-Identifier: BSD-3-Clause
"""What the nodes of both sides do alike: read their parameters, and load the streams they name."""
import math
import os

import rospkg
import rospy

from ..streams import config


def number_parameter(name, default, least=None, most=None, tell=rospy.logerr):
    """A number from the parameter server; what is no number in the limits is told of, and the default stands.

    :param tell: f(problem)
    """
    value = rospy.get_param(name, default)
    good = isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
    if good and (least is None or value >= least) and (most is None or value <= most):
        return value
    limits = ['from %g' % least] * (least is not None) + ['to %g' % most] * (most is not None)
    tell('%s is %r, must be a number %s: %r is used' % (rospy.resolve_name(name), value, ' '.join(limits), default))
    return default


def read_file(parameter, default, load, tell):
    """The good parts of the file that a node's parameter names; what is wrong is told of.

    :param default: its name in this package's config
    :param load: f(text) -> (good, [problem, ...])
    :param tell: f(problem)
    """
    path = rospy.get_param(parameter, '') or os.path.join(
        rospkg.RosPack().get_path('smokebot_udp'), 'config', default)
    try:
        with open(path) as file:
            good, problems = load(file.read())
    except (OSError, UnicodeDecodeError) as error:
        good, problems = {}, ['it cannot be read: %s' % error]
    for problem in problems:
        tell('%s: %s' % (path, problem))
    return good


def read_streams(tell=rospy.logerr):
    """The good streams of the node's ~streams_file: {name: settings}."""
    return read_file('~streams_file', 'streams.yaml', config.load, tell)


def load_streams(class_of, link, tell):
    """Start each stream of the node's ~streams_file; one that cannot start leaves the others running.

    :param class_of: streams.robot_class or streams.operator_class
    :param tell: f(problem)
    :return: {name: stream}
    """
    streams = {}
    for name, settings in read_streams(tell).items():
        try:
            stream = class_of(settings['type'])(name, settings, link)
            stream.start()
            streams[name] = stream
        except Exception as error:
            tell("stream '%s' (%s) does not start: %s" % (name, settings['type'], error))
    return streams
