# SPDX-License-Identifier: BSD-3-Clause
"""Settings that change while a node runs, by the ways ROS users know: dynamic_reconfigure and rosparam.

Whichever way a value comes, it is checked by the same table, takes effect at once, and then shows in the other.
What rosparam sets wrongly is told of and set back; dynamic_reconfigure clamps, as it always does.
"""
import threading
from types import SimpleNamespace

import rospy
from dynamic_reconfigure.server import Server
from rospy.impl.paramserver import get_param_server_cache

from .. import udpros
from ..mission.parameters import check_one

PUBLISHING = threading.Lock()
"""Held while this node writes parameters, and while it looks what others wrote."""

TYPES = {bool: 'bool', int: 'int', float: 'double', str: 'str'}
LIMITS = {bool: (False, True), int: (-2 ** 31, 2 ** 31 - 1), float: (-float('inf'), float('inf')), str: ('', '')}


def config_type(name, table):
    """What dynamic_reconfigure's generator would make of a table {name: Parameter}: a server's `type`."""
    parameters, low, high = [], {}, {}
    for key, parameter in table.items():
        kind = type(parameter.default)
        least = parameter.above if parameter.above is not None else parameter.least
        low[key] = LIMITS[kind][0] if least is None else kind(least)
        high[key] = LIMITS[kind][1] if parameter.most is None else kind(parameter.most)
        unit = ' [%s]' % parameter.unit if parameter.unit else ''
        parameters.append({
            'name': key, 'type': TYPES[kind], 'level': 0, 'description': parameter.meaning + unit,
            'edit_method': _enum(parameter.choices), 'default': parameter.default, 'min': low[key], 'max': high[key]})
    group = {'name': 'Default', 'type': '', 'state': True, 'cstate': 'true', 'id': 0, 'parent': 0, 'groups': [],
             'parameters': parameters}
    return SimpleNamespace(
        __name__=name, config_description=group, defaults={key: p.default for key, p in table.items()}, min=low,
        max=high, level={key: 0 for key in table}, type={key: TYPES[type(p.default)] for key, p in table.items()},
        all_level=0)


def _enum(choices):
    if not choices:
        return ''
    constants = [{'name': choice, 'type': 'str', 'value': choice, 'description': '', 'srcline': 0, 'srcfile': '',
                  'cconsttype': 'const char * const', 'ctype': 'std::string'} for choice in choices]
    return repr({'enum': constants, 'enum_description': ''})


class LiveSettings:
    """The live settings of one part of a node, under ~<name>/ (or ~ where the name is empty).

    :param table: {name: Parameter}, of which all can change
    :param values: {name: value} at the start, at least of the table
    :param apply: f({name: value} with all of the table), at once when one changed; ValueError refuses
    :param lock: an RLock, shared by parts whose apply changes another
    :param tell: f(problem), told what is refused
    """

    def __init__(self, name, table, values, apply, lock, tell):
        self.name, self.table = name, table
        self.values = {key: values[key] for key in table}
        self._apply = apply
        self._lock = lock
        self._tell = tell
        self._published = {}    # what the parameter server was told
        self._server = None

    def adopt(self, found):
        """Take what was set before the node started: {name: value}."""
        for name in self.table:
            if name in found:
                try:
                    self.set({name: found[name]})
                except ValueError as error:
                    self._tell('%s refused, it is %r: %s' % (self.key(name), self.values[name], error))
        self._published = dict(self.values)

    def serve(self):
        """Begin to serve dynamic_reconfigure."""
        self._server = _Server(self)

    def key(self, name):
        """The parameter's resolved name."""
        return rospy.resolve_name('~%s/%s' % (self.name, name) if self.name else '~' + name)

    def set(self, changes):
        """Change some values; they take effect before this returns, and `show` them later.

        :raises ValueError: naming the setting and its value; nothing is changed then
        """
        with self._lock:
            wanted = {**self.values, **{name: check_one(name, value, self.table) for name, value in changes.items()}}
            if wanted != self.values:
                self._apply(wanted)
                self.values = wanted

    def show(self):
        """Let dynamic_reconfigure and the parameter server show the values there are."""
        if self._server is not None:
            with self._lock:
                values = dict(self.values)
            self._server.update_configuration(values)

    def reconfigured(self, config, level):
        """dynamic_reconfigure's callback: what it returns is what it shows."""
        with self._lock:
            try:
                self.set({name: config[name] for name in self.table})
            except ValueError as error:
                self._tell('%s: %s' % (self.key('')[:-1], error))
            config.update(self.values)
        return config

    def publish(self, values):
        """Write to the parameter server what it does not have yet."""
        with PUBLISHING:
            for name in self.table:
                if name not in self._published or not _same(values[name], self._published[name]):
                    self._publish(name, values[name])

    def _publish(self, name, value):
        rospy.set_param(self.key(name), value)
        self._published[name] = value

    def look(self, found):
        """Take what somebody else set on the parameter server, or set it back.

        :param found: {name: value} there
        :return: whether there was anything
        """
        news = {name: found[name] for name in self.table
                if name in found and not _same(found[name], self._published[name])}
        for name, value in news.items():
            self._published[name] = value
            try:
                self.set({name: value})
            except ValueError as error:
                self._tell('%s refused, %r stays: %s' % (self.key(name), self.values[name], error))
                self._publish(name, self.values[name])
        return bool(news)


class _Server(Server):
    """dynamic_reconfigure's server for LiveSettings; writes to the parameter server what changed, not all."""

    def __init__(self, settings):
        self._settings = settings
        super().__init__(config_type(settings.name or 'node', settings.table), settings.reconfigured,
                         namespace=settings.name and '~' + settings.name)

    def _copy_from_parameter_server(self):
        self.config.update(self._settings.values)    # LiveSettings.adopt asked the parameter server

    def _copy_to_parameter_server(self):
        self._settings.publish({name: self.config[name] for name in self._settings.table})


def _same(one, other):
    return type(one) is type(other) and one == other


class ParameterWatch:
    """Starts the live settings of a node, and takes what is set under its private namespace.

    The master tells of it, nothing is polled. Over a bad link each question to the master takes its time, so there
    are few, and an operator's node asks them in the background.

    :param parts: [LiveSettings, ...]
    :param background: whether they start in a thread
    """

    def __init__(self, parts, background):
        self._parts = parts
        self._changed = threading.Event()
        self._ended = False
        self._begun = not background
        if self._begun:
            self._begin()
        self._thread = threading.Thread(target=self._run, name='parameters', daemon=True)
        self._thread.start()

    def _begin(self):
        found = _found()
        for part in self._parts:
            part.adopt(_of(found, part))
            if part.name:
                found[part.name] = {**_of(found, part), **part.values}
            else:
                found.update(part.values)
        rospy.set_param('~', found)
        rospy.get_param_cached('~')     # subscribes
        get_param_server_cache().set_notifier(lambda key, value: self._changed.set())
        with udpros.registered_together():
            for part in self._parts:
                part.serve()

    def stop(self):
        self._ended = True
        self._changed.set()
        if self._begun:
            self._thread.join()

    def _run(self):
        try:
            if not self._begun:
                self._begin()
                self._begun = True
        except Exception as error:
            if not self._ended:
                rospy.logerr('settings cannot be changed while this runs: %s', error)
            return
        while True:
            self._changed.wait()
            self._changed.clear()
            if self._ended:
                return
            try:
                self._look()
            except Exception as error:
                if not rospy.is_shutdown():
                    rospy.logerr_throttle_identical(5, 'the parameters cannot be read: %s' % error)

    def _look(self):
        with PUBLISHING:    # else what we are about to write looked like somebody else's
            found = _found()
            news = [part for part in self._parts if part.look(_of(found, part))]
        for part in news:
            part.show()


def _found():
    """What the parameter server has in the node's private namespace."""
    found = rospy.get_param('~', {})
    return found if isinstance(found, dict) else {}


def _of(found, part):
    """Of that what belongs to a part."""
    mine = found.get(part.name, {}) if part.name else found
    return mine if isinstance(mine, dict) else {}
