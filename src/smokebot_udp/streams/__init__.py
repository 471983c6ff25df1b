# SPDX-License-Identifier: BSD-3-Clause
"""The streams by their type's name: one class for the robot's side, one for the operator's.

A node loads a stream's class when it is first named, so that a kind costs nothing where it is not used.
"""
import importlib

KINDS = {
    'cloud': ('cloud', 'CloudSender', 'CloudReceiver'),
    'grid': ('grid', 'GridSender', 'GridReceiver'),
    'image': ('image', 'ImageSender', 'ImageReceiver'),
    'relay': ('relay', 'RelaySender', 'RelayReceiver'),
    'scan': ('scan', 'ScanSender', 'ScanReceiver'),
    'virtual_scan': ('virtual_scan', 'VirtualScanSender', 'VirtualScanReceiver'),
}
"""{type in streams.yaml: (module of this package, class on the robot, class on the operator's side)}"""


def robot_class(kind):
    """The class that sends this kind of stream."""
    module, sender, _ = KINDS[kind]
    return getattr(importlib.import_module('.' + module, __name__), sender)


def operator_class(kind):
    """The class that receives this kind of stream."""
    module, _, receiver = KINDS[kind]
    return getattr(importlib.import_module('.' + module, __name__), receiver)
