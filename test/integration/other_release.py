#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A node of this package that says it is of another release: `other_release.py NODE WIRE_FORMAT RELEASE [ARG ...]`."""
import importlib
import sys

from smokebot_udp import version

node, wire_format, release = sys.argv[1:4]
del sys.argv[1:4]
version.OURS = version.Software(int(wire_format), release)      # before any other module takes it
importlib.import_module('smokebot_udp.nodes.' + node).main()
