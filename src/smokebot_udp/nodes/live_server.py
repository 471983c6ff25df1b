# SPDX-License-Identifier: BSD-3-Clause
"""dynamic_reconfigure's server for live settings, and how it describes their tables to its clients."""
from types import SimpleNamespace
from typing import Any, Dict, Mapping

from dynamic_reconfigure.encoding import decode_config, encode_config
from dynamic_reconfigure.server import Server

from ..mission.parameters import Parameter, Table
from .live import PUBLISHING, LiveSettings, found_on_master, publish_all

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


def serve(settings: LiveSettings) -> None:
    """Begin to serve dynamic_reconfigure, unless it is served already."""
    settings.server = settings.server or ReconfigureServer(settings)


class ReconfigureServer(Server):
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
            self._settings.read(found_on_master(self._settings.node))
            known = self._known(decode_config(request.config))
            wanted = self.config.copy()
            wanted.update(known)
            self._clamp(wanted)
            sends_all = len(known) == len(self._settings.store.table) > 1
            try:
                self._settings.request({name: wanted[name] for name in known
                                        if not sends_all or wanted[name] != self.config[name]})
            except ValueError as error:
                self._settings.report('%s: %s' % (self._settings.namespace, error))
            return encode_config(self._change_config(self.config, 0))

    def _known(self, wanted: Mapping[str, Any]) -> Dict[str, Any]:
        """The settings that a client sends; unknown ones are reported."""
        unknown = sorted(set(wanted) - set(self._settings.store.table))
        if unknown:
            self._settings.report('%s: %s: no such setting' % (self._settings.namespace, ', '.join(unknown)))
        return {name: value for name, value in wanted.items() if name in self._settings.store.table}

    def _change_config(self, config: Any, level: int) -> Any:
        with PUBLISHING:
            # otherwise a value that was just set would be overwritten unread
            self._settings.read(found_on_master(self._settings.node))
            return super()._change_config(config, level)

    def _copy_from_parameter_server(self) -> None:
        self.config.update(self._settings.values)    # ParameterWatch has read the parameter server

    def _copy_to_parameter_server(self) -> None:
        publish_all([self._settings])
