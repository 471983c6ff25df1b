# SPDX-License-Identifier: BSD-3-Clause
"""The types of streams: each has an encoder (robot's side) and an assembler (operator's side) in a folder of its own.

Commands, services and actions have neither: messages cross as they are, and their folders have only settings. Likewise
reliable relays, which are a kind of their own, see `kind_of`.

A type is imported when the first stream of it is made, so types that are not used cost no time and no memory.
"""
import importlib
from typing import Any, Dict, Mapping, NamedTuple, Type

from ..mission.parameters import EXCHANGES, RELIABLE, Table, kind_of, live
from .assembler import Assembler
from .encoder import Encoder

KINDS = {'cloud': 'Cloud', 'grid': 'Grid', 'image': 'Image', 'relay': 'Relay', 'scan': 'Scan',
         'virtual_scan': 'VirtualScan'}
"""{`type` in streams.yaml, name of a sub-package: first part of its classes' names}, of those with an encoder"""

RECEIVED_AS = {'virtual_scan': 'scan'}
"""{type that crosses as another one does: that one}"""

TYPES = tuple(sorted([*KINDS, *EXCHANGES]))
"""All values of `type`."""

Named = Dict[str, Any]
"""{name of a stream: its settings}"""


class Tables(NamedTuple):
    """The settings of a type in streams.yaml."""
    robot: Table
    operator: Table


class Definitions(NamedTuple):
    """Streams by what runs them."""
    streams: Named
    """Those with an encoder and an assembler."""
    commands: Named
    services: Named
    actions: Named
    reliable: Named
    """Reliable relays, in either direction."""


def classified(definitions: Mapping[str, Mapping[str, Any]]) -> Definitions:
    """The streams of a streams.yaml, by what runs them; their order stays.

    :param definitions: {name: settings}, as config.load returns them
    """
    found = Definitions({}, {}, {}, {}, {})
    exchanges = {'command': found.commands, 'service': found.services, 'action': found.actions,
                 RELIABLE: found.reliable}
    for name, settings in definitions.items():
        exchanges.get(kind_of(settings), found.streams)[name] = settings
    return found


def tables(kind: str) -> Tables:
    """The settings of both sides of this kind, see `kind_of`."""
    if kind in {*EXCHANGES, RELIABLE}:
        module = parameters_module(kind)
        return Tables(module.ROBOT, module.OPERATOR)
    return Tables(encoder_class(kind).PARAMETERS, assembler_class(kind).PARAMETERS)


def live_tables(settings: Mapping[str, Any]) -> Tables:
    """The settings of both sides of a stream that may change while it runs.

    :param settings: of the stream
    """
    return Tables(*map(live, tables(kind_of(settings))))


def parameters_module(kind: str) -> Any:
    """The module with the settings and the `check` of a relay, reliable or not, command, service or action."""
    return importlib.import_module('.%s.parameters' % kind, __name__)


def encoder_class(kind: str) -> Type[Encoder[Any]]:
    """The class of the robot's side of this type, one of KINDS."""
    found: Type[Encoder[Any]] = getattr(
        importlib.import_module('.%s.encoder' % kind, __name__), KINDS[kind] + 'Encoder')
    return found


def assembler_class(kind: str) -> Type[Assembler[Any, Any]]:
    """The class of the operator's side of this type, one of KINDS."""
    kind = RECEIVED_AS.get(kind, kind)
    found: Type[Assembler[Any, Any]] = getattr(
        importlib.import_module('.%s.assembler' % kind, __name__), KINDS[kind] + 'Assembler')
    return found
