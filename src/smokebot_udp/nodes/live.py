# SPDX-License-Identifier: BSD-3-Clause
"""Settings that change while a node runs, by the ways ROS users know: dynamic_reconfigure and rosparam.

Whichever way a value comes, a SettingsStore checks it and holds it, it takes effect at once, and the other way shows
it. What rosparam sets wrongly is reported and set back; dynamic_reconfigure clamps, as it always does.
"""
import threading
from types import SimpleNamespace
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence

import rospy
from dynamic_reconfigure.encoding import decode_config, encode_config
from dynamic_reconfigure.server import Server
from rospy.impl.paramserver import get_param_server_cache

from .. import udpros
from ..limited_log import logerr
from ..mission.mirror import Mirror
from ..mission.parameters import Parameter, Table
from ..mission.settings import SettingsStore
from ..udpros.master import keep_parameters, write_parameters
from .logging import log_error
from .parameters import DIAGNOSTICS

PUBLISHING = threading.RLock()
"""Held while this node writes parameters, and while it reads what others wrote. Taken after a server's mutex."""

RETRY_PERIOD = 1.0
"""Time between attempts to start the settings where the master does not answer [s]."""

TYPES = {bool: 'bool', int: 'int', float: 'double', str: 'str'}
LIMITS: Dict[type, Any] = {bool: (False, True), int: (-2 ** 31, 2 ** 31 - 1), float: (-float('inf'), float('inf')),
                           str: ('', '')}


def config_type(name: str, table: Table) -> SimpleNamespace:
    """What dynamic_reconfigure's generator would make of a table {name: Parameter}: a server's `type`."""
    low, high = {}, {}
    for key, parameter in table.items():
        low[key] = LIMITS[parameter.kind][0] if parameter.minimum is None else parameter.kind(parameter.minimum)
        high[key] = LIMITS[parameter.kind][1] if parameter.most is None else parameter.kind(parameter.most)
    described = {'name': 'Default', 'type': '', 'state': True, 'cstate': 'true', 'id': 0, 'parent': 0, 'groups': [],
                 'parameters': [_described(key, parameter) for key, parameter in table.items()]}
    return SimpleNamespace(
        __name__=name, config_description=described, min=low, max=high, all_level=0,
        defaults={key: parameter.default for key, parameter in table.items()}, level={key: 0 for key in table},
        type={key: TYPES[parameter.kind] for key, parameter in table.items()})


def _described(name: str, parameter: Parameter) -> Dict[str, Any]:
    unit = ' [%s]' % parameter.unit if parameter.unit else ''
    constants = [{'name': choice, 'type': 'str', 'value': choice, 'description': '', 'srcline': 0, 'srcfile': '',
                  'cconsttype': 'const char * const', 'ctype': 'std::string'} for choice in parameter.choices]
    return {'name': name, 'type': TYPES[parameter.kind], 'level': 0, 'description': parameter.meaning + unit,
            'edit_method': repr({'enum': constants, 'enum_description': ''}) if constants else ''}


class LiveSettings:
    """The live settings of one part of a node, under <node>/<name>/ (or <node>/ where the name is empty).

    :param store: SettingsStore
    :param report: f(problem), called with what is refused
    :param request: requests changes of the store; None: the store itself does
    :param node: namespace of the node's parameters; None: this node's private ones
    """

    def __init__(self, name: str, store: SettingsStore, report: Callable[[str], None],
                 request: Optional[Callable[[Mapping[str, Any]], Any]] = None, node: Optional[str] = None) -> None:
        self.name, self.store = name, store
        self.node = node or rospy.get_name()
        self.namespace = '%s/%s' % (self.node, name) if name else self.node
        self.request, self._report = request or store.request, report
        others = None if not name else DIAGNOSTICS if node is None else ()
        self._mirror = Mirror(self.namespace, store, self.request, report, others)
        self._server: Optional[_Server] = None

    @property
    def values(self) -> Dict[str, Any]:
        """{name: value} as requested."""
        requested = self.store.current.requested
        return {name: requested[name] for name in self.store.table}

    def read(self, found: Mapping[str, Any]) -> bool:
        """Take values that others set on the parameter server.

        :param found: what is in the node's namespace
        :return: whether anything was set
        """
        return self._mirror.read(found.get(self.name, {}) if self.name else found)

    def publish(self) -> None:
        """Write values that differ to the parameter server; PUBLISHING is held."""
        publish_all([self])

    def serve(self) -> None:
        """Begin to serve dynamic_reconfigure."""
        self._server = self._server or _Server(self)

    def show(self) -> None:
        """Show the requested values in dynamic_reconfigure and on the parameter server."""
        if self._server is not None:
            self._server.show()

    def reconfigure(self, changes: Mapping[str, Any]) -> None:
        """Request the changes of a client of dynamic_reconfigure; a refusal is reported."""
        try:
            self.request(changes)
        except ValueError as error:
            self._report('%s: %s' % (self.namespace, error))

    def known(self, wanted: Mapping[str, Any]) -> Dict[str, Any]:
        """The settings that a client of dynamic_reconfigure sends; unknown ones are reported."""
        unknown = sorted(set(wanted) - set(self.store.table))
        if unknown:
            self._report('%s: %s: no such setting' % (self.namespace, ', '.join(unknown)))
        return {name: value for name, value in wanted.items() if name in self.store.table}

    def to_publish(self) -> Dict[str, Any]:
        """{name: value} that differs on the parameter server."""
        return self._mirror.to_write()

    def published(self, values: Mapping[str, Any]) -> None:
        """The parameter server has {name: value} now."""
        self._mirror.written(values)


def publish_all(parts: Sequence[LiveSettings]) -> None:
    """Write the values that differ to the parameter server, in one call, and nothing else; PUBLISHING is held."""
    news = [(part, part.to_publish()) for part in parts]
    write_parameters({'%s/%s' % (part.namespace, name): value for part, values in news
                      for name, value in values.items()})
    for part, values in news:
        part.published(values)


class _Server(Server):
    """dynamic_reconfigure's server for LiveSettings: it shows the store's values, and requests clients' changes."""

    def __init__(self, settings: LiveSettings) -> None:
        self._settings = settings
        super().__init__(config_type(settings.name or 'node', settings.store.table), self._shown,
                         namespace=settings.namespace)

    def show(self) -> None:
        """Publish the store's values, to clients and to the parameter server."""
        with self.mutex:
            self._change_config(self.config, 0)

    def _shown(self, config: Any, level: int) -> Any:
        config.update(self._settings.values)
        return config

    def _set_callback(self, request: Any) -> Any:
        """Serve a client. If it sends all values, only those that differ from the values last shown are changes: the
        store's may be newer."""
        with self.mutex, PUBLISHING:
            self._settings.read(_found(self._settings.node))
            known = self._settings.known(decode_config(request.config))
            wanted = self.config.copy()
            wanted.update(known)
            self._clamp(wanted)
            sends_all = len(known) == len(self._settings.store.table) > 1
            self._settings.reconfigure({name: wanted[name] for name in known
                                        if not sends_all or wanted[name] != self.config[name]})
            return encode_config(self._change_config(self.config, 0))

    def _change_config(self, config: Any, level: int) -> Any:
        with PUBLISHING:
            # otherwise a value that was just set would be overwritten unread
            self._settings.read(_found(self._settings.node))
            return super()._change_config(config, level)

    def _copy_from_parameter_server(self) -> None:
        self.config.update(self._settings.values)    # ParameterWatch has read the parameter server

    def _copy_to_parameter_server(self) -> None:
        self._settings.publish()


class ParameterWatch:
    """Starts live settings, and takes values set under their node's namespace.

    The master notifies, nothing is polled. Over a bad link each call of the master takes its time, so there are few,
    and an operator's node makes them in the background.

    :param parts: [LiveSettings, ...] of this node, which take over the values that are there already
    :param background: whether they start in a thread
    :param node: namespace of another node whose settings are shown here, as `add` gets them; None: this node's
    """

    def __init__(self, parts: Sequence[LiveSettings], background: bool, node: Optional[str] = None) -> None:
        self._node = node or rospy.get_name()
        self._parts = list(parts)
        self._late: List[LiveSettings] = []     # that are to be started
        self._changed = threading.Event()
        self._ended = self._follows = False
        self._log_error = log_error('settings cannot be changed until the master answers')
        self._begun = node is not None or (not background and self._begin(self._adopt))
        self._thread = threading.Thread(target=self._run, name='parameters', daemon=True)
        self._thread.start()

    def add(self, part: LiveSettings) -> None:
        """Start settings in the background; their values replace those that are there, as of an earlier time."""
        self._late.append(part)
        self._changed.set()

    def _begin(self, start: Callable[[], None]) -> bool:
        """Start live settings; whether this succeeded: the master may have just ended."""
        try:
            start()
        except Exception as error:
            self._log_error(error)
            return False
        return True

    def _adopt(self) -> None:
        with PUBLISHING:
            found = _found(self._node)
            for part in self._parts:
                part.read(found)
            publish_all(self._parts)
        self._follow()
        with udpros.registered_together():
            for part in self._parts:
                part.serve()
        self._changed.set()     # nobody notifies of what was set after the values were written, and before _follow

    def _start_late(self) -> None:
        late = list(self._late)
        with PUBLISHING:
            publish_all(late)
        self._follow()
        with udpros.registered_together():
            for part in late:
                part.serve()
        self._parts += late
        del self._late[:len(late)]

    def _follow(self) -> None:
        """Have the master notify of changes, also a new one."""
        keep_parameters(self._node)
        rospy.get_param_cached(self._node)      # subscribes
        # rospy ignores updates of names that its cache lacks: of all whose namespace was replaced
        cache = get_param_server_cache()
        with PUBLISHING:
            if not self._follows:   # or an attempt before has failed later
                self._update_known, cache.update = cache.update, self._update
                self._follows = True

    def _update(self, key: str, value: Any) -> None:
        """The cache's update: a parameter has changed, by the master's notification or by rospy.set_param."""
        if not (key + '/').startswith(self._node + '/'):
            self._update_known(key, value)
            return
        get_param_server_cache().set(key, value)
        self._changed.set()

    def stop(self) -> None:
        """End the thread."""
        self._ended = True
        self._changed.set()
        if self._begun:
            self._thread.join()

    def _run(self) -> None:
        while not self._begun and not self._ended:
            self._begun = self._begin(self._adopt)
            if not self._begun:
                self._changed.wait(RETRY_PERIOD)    # set by `stop`
                self._changed.clear()
        while not self._ended:
            self._changed.wait()
            self._changed.clear()
            if self._late and not self._ended and not self._begin(self._start_late):
                self._changed.wait(RETRY_PERIOD)
                self._changed.set()
                continue
            try:
                if not self._ended:
                    self._read()
            except Exception as error:
                logerr('the parameters cannot be read', error)

    def _read(self) -> None:
        with PUBLISHING:    # otherwise values that this node is about to write would look like another node's
            found = _found(self._node)
            news = [part for part in self._parts if part.read(found)]
        for part in news:
            part.show()


def _found(node: str) -> Dict[str, Any]:
    """What the parameter server has in a node's namespace; a copy, for rospy's cache changes."""
    found = rospy.get_param(node, {})
    return {name: dict(value) if isinstance(value, dict) else value
            for name, value in dict(found).items()} if isinstance(found, dict) else {}
