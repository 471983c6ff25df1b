# SPDX-License-Identifier: BSD-3-Clause
"""How datagrams leave this machine, as its kernel has it."""
import contextlib
import ipaddress
import socket

from ..monitoring.wifi_texts import Route, route_interface

ROUTES = '/proc/net/route'
"""The routes of this machine, without those to the machine itself."""

LOOPBACK = 'lo'

PROBE_PORT = 9
"""Any port: the socket sends nothing."""


def route_to(host: str) -> Route:
    """How datagrams leave this machine for a host, as the kernel has it now.

    :param host: an IPv4 address
    """
    with contextlib.suppress(ValueError, OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect((str(ipaddress.IPv4Address(host)), PROBE_PORT))
        own = str(probe.getsockname()[0])
        return Route(own, LOOPBACK if own == host else route_interface(_routes(), host) or '')
    return Route('', '')


def _routes() -> str:
    """/proc/net/route; empty where it cannot be read."""
    with contextlib.suppress(OSError), open(ROUTES) as file:
        return file.read()
    return ''
