# SPDX-License-Identifier: BSD-3-Clause
"""The types of streams: each has an encoder (robot's side) and an assembler (operator's side) in a folder of its own.

A type is imported when the first stream of it is made, so types that are not used cost no time and no memory.
"""
import importlib
from typing import Any, Type

from .assembler import Assembler
from .encoder import Encoder

KINDS = {'cloud': 'Cloud', 'grid': 'Grid', 'image': 'Image', 'relay': 'Relay', 'scan': 'Scan',
         'virtual_scan': 'VirtualScan'}
"""{`type` in streams.yaml, name of a sub-package: first part of its classes' names}"""


def encoder_class(kind: str) -> Type[Encoder[Any]]:
    """The class of the robot's side of this type."""
    found: Type[Encoder[Any]] = getattr(
        importlib.import_module('.%s.encoder' % kind, __name__), KINDS[kind] + 'Encoder')
    return found


def assembler_class(kind: str) -> Type[Assembler[Any, Any]]:
    """The class of the operator's side of this type."""
    found: Type[Assembler[Any, Any]] = getattr(
        importlib.import_module('.%s.assembler' % kind, __name__), KINDS[kind] + 'Assembler')
    return found
