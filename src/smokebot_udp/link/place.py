# SPDX-License-Identifier: BSD-3-Clause
"""Where packets come from and go to: the other side's address, and by which interface of this machine.

An answer leaves by the interface by which the packet came, from the address to which it came. The kernel's routes know
one interface for each address of the other side; a robot with two modems is asked by both of them.
"""
from typing import NamedTuple, Tuple

from ..arrays import Records
from ..udpros.control_messages import KERNELS, Via
from ..udpros.endpoints import interface_name

Address = Tuple[str, int]
"""Host and port."""


class Place(NamedTuple):
    """The other side, and how it is reached."""
    number: int
    """IPv4 address."""
    port: int
    via: Via = KERNELS

    def covers(self, source: 'Place') -> bool:
        """Whether a packet from there has come from this place: where it names no interface, by any of them."""
        return self[:2] == source[:2] and self.via.interface in (0, source.via.interface)


def address_of(place: Place) -> Address:
    """The dotted address and the port of a place."""
    return '%d.%d.%d.%d' % tuple(place.number.to_bytes(4, 'big')), place.port


def interface_of(place: Place) -> str:
    """The name of the interface by which a place is reached; empty: the kernel's routes decide."""
    return interface_name(place.via.interface)


def path_of(place: Place) -> Place:
    """What identifies the path to a place: behind a NAT its port may change."""
    return Place(place.number, 0, Via(place.via.interface))


def place_at(address: Address, interface: int = 0) -> Place:
    """The place of a dotted address and a port.

    :param interface: index of the one of this machine by which it is reached; 0: by the kernel's routes
    """
    host, port = address
    return Place(int.from_bytes(bytes(int(part) for part in host.split('.')), 'big'), port, Via(interface))


def place_of(sources: Records, row: int) -> Place:
    """Who sent a row's packet, and to where."""
    source = sources[row]
    return Place(int(source['address']), int(source['port']), Via(int(source['interface']), int(source['local'])))
