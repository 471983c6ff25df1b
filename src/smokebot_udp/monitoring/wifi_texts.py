# SPDX-License-Identifier: BSD-3-Clause
"""Reads what Linux says about Wi-Fi: the outputs of iw, and files of /proc/net.

iw prints the answers of nl80211 (linux/nl80211.h). Drivers differ in what they report, and some report nonsense: values
that cannot be are unknown. None, or NaN, stands for what is unknown.
"""
import ipaddress
import math
import re
import struct
from dataclasses import dataclass
from typing import Dict, List, NamedTuple, Optional

MIN_DBM, MAX_DBM = -120.0, -1.0
"""Signals and noise outside of this are a driver's way to say nothing, such as 0, 75 or -256."""

SIGNALS = 'signal', 'signal avg', 'beacon signal avg'
"""Some drivers give averages only."""

_STATION = re.compile(r'^Station ([0-9A-Fa-f:]{17}) \(on \S+\)')
_LINK = re.compile(r'^\s*Link \d+:')
_NUMBER = re.compile(r'-?\d+(\.\d+)?')


@dataclass(frozen=True)
class Station:
    """One station of an interface: the access point, a client of this access point, or a neighbour in a mesh."""
    address: str = ''
    """MAC address; empty: unknown."""
    signal: float = math.nan
    """Signal level of what was received from the station [dBm]."""
    tx_bitrate: float = math.nan
    """Bit rate of what is transmitted to the station [Mbit/s]."""
    rx_bitrate: float = math.nan
    """Bit rate of what is received from the station [Mbit/s]."""
    retries: Optional[int] = None
    """Transmissions that were repeated, until now."""
    failed: Optional[int] = None
    """Frames that were given up, until now."""
    beacon_loss: Optional[int] = None
    """How often the access point's beacons failed to come, until now."""


class Link(NamedTuple):
    """The association of an interface with an access point."""
    ssid: str
    station: Station


class WirelessRow(NamedTuple):
    """An interface in /proc/net/wireless."""
    signal: float
    """[dBm]"""
    noise: float
    """[dBm]"""
    failed: int
    """Frames that were given up after all retries, until now."""
    missed_beacons: int


def ssids(text: str) -> Dict[str, str]:
    """{interface: its SSID, or mesh ID; empty: it has none} from the output of `iw dev`."""
    found: Dict[str, str] = {}
    name = ''
    for line in text.splitlines():
        key, _, value = line.strip().partition(' ')
        if key == 'Interface':
            name = value
            found[name] = ''
        elif key == 'Unnamed/non-netdev':
            name = ''
        elif key == 'ssid' and name:
            found[name] = value
    return found


def stations(text: str) -> List[Station]:
    """The stations in the output of `iw dev IF station dump`."""
    found: List[List[Dict[str, str]]] = []      # of each its own values, then those of each link
    for line in text.splitlines():
        head = _STATION.match(line)
        if head:
            found.append([{'address': head.group(1).lower()}])
        elif found and _LINK.match(line):
            found[-1].append({})
        elif found:
            key, _, value = line.strip().partition(':')
            found[-1][-1].setdefault(key, value)
    return [_station(*values) for values in found]


def link(text: str) -> Optional[Link]:
    """The association in the output of `iw dev IF link`; None: there is none."""
    lines = text.splitlines()
    if not lines or not lines[0].startswith(('Connected to ', 'Joined IBSS ')):
        return None
    values: Dict[str, str] = {}
    for line in lines[1:]:
        key, _, value = line.strip().partition(':')
        values.setdefault(key, value)
    return Link(values.get('SSID', '').strip(), _station({**values, 'address': lines[0].split()[2].lower()}))


def noise(text: str) -> float:
    """The noise on the channel in use, from the output of `iw dev IF survey dump`; NaN: unknown [dBm]."""
    in_use = False
    for line in text.splitlines():
        key, _, value = line.strip().partition(':')
        if key == 'frequency':
            in_use = '[in use]' in value
        elif key == 'noise' and in_use:
            return _dbm(value)
    return math.nan


def wireless_rows(text: str) -> Dict[str, WirelessRow]:
    """{interface: its row} of /proc/net/wireless, which has the values of the older wireless extensions."""
    rows: Dict[str, WirelessRow] = {}
    for line in text.splitlines():
        name, colon, rest = line.partition(':')
        cells = rest.split()
        if colon and len(cells) >= 10:
            values = [_number(cell.rstrip('.')) for cell in cells[1:10]]
            if all(map(math.isfinite, values)):
                rows[name.strip()] = WirelessRow(_level(values[1]), _level(values[2]), int(values[6]), int(values[8]))
    return rows


class Route(NamedTuple):
    """How datagrams leave this machine for a host."""
    own: str
    """This machine's address; empty: there is no route."""
    interface: str
    """Empty: unknown."""


def route_interface(text: str, address: str) -> Optional[str]:
    """The interface by which IPv4 packets leave for an address, from /proc/net/route; None: unknown.

    The route with the longest mask counts, of several the one with the lowest metric, as in the kernel.
    """
    try:
        target = int(ipaddress.IPv4Address(address))
    except ValueError:
        return None
    found = []
    for line in text.splitlines()[1:]:
        cells = line.split()
        try:
            name, destination, flags, metric, mask = cells[0], *(
                int(cells[at], base) for at, base in ((1, 16), (3, 16), (6, 10), (7, 16)))
        except (IndexError, ValueError):
            continue
        destination, mask = _host_order(destination), _host_order(mask)
        if flags & 1 and target & mask == destination:      # RTF_UP
            found.append((mask, -metric, name))
    return max(found)[2] if found else None


def hardware_address(text: str, address: str) -> Optional[str]:
    """The MAC address of an IPv4 address in /proc/net/arp; None: it is not there."""
    for line in text.splitlines()[1:]:
        cells = line.split()
        if len(cells) >= 6 and cells[0] == address and cells[3] != '00:00:00:00:00:00':
            return cells[3].lower()
    return None


def _station(values: Dict[str, str], *links: Dict[str, str]) -> Station:
    """:param values: {key: value} as iw prints them
    :param links: likewise, of a multi-link station (Wi-Fi 7), whose own signal may be 0
    """
    signal = _signal(values)
    if math.isnan(signal):
        signal = max([known for known in map(_signal, links) if not math.isnan(known)], default=math.nan)
    return Station(
        values['address'], signal,
        _number(values.get('tx bitrate', '')), _number(values.get('rx bitrate', '')),
        _count(values.get('tx retries', '')), _count(values.get('tx failed', '')),
        _count(values.get('beacon loss', '')))


def _signal(values: Dict[str, str]) -> float:
    """The first signal that can be [dBm]; NaN: none."""
    signals = [_dbm(values.get(key, '')) for key in SIGNALS]
    return next((signal for signal in signals if not math.isnan(signal)), math.nan)


def _number(text: str) -> float:
    """The number with which a text begins; NaN: none."""
    found = _NUMBER.match(text.strip())
    return float(found.group()) if found else math.nan


def _count(text: str) -> Optional[int]:
    number = _number(text)
    return int(number) if number >= 0 else None


def _dbm(text: str) -> float:
    number = _number(text)
    return number if MIN_DBM <= number <= MAX_DBM else math.nan


def _level(value: float) -> float:
    """A level of /proc/net/wireless in dBm: some drivers give it as a byte, 256 above its value."""
    value = value - 256 if value > 63 else value
    return value if MIN_DBM <= value <= MAX_DBM else math.nan


def _host_order(number: int) -> int:
    """An address of /proc/net/route, which has the bytes as they are in memory."""
    return int(struct.unpack('!I', struct.pack('=I', number & 0xffffffff))[0])
