# SPDX-License-Identifier: BSD-3-Clause
"""The state of the Wi-Fi interface that carries the link, on either side.

Time is an argument: seconds of a monotonic clock.
"""
import math
from dataclasses import dataclass
from typing import Dict, NamedTuple, Optional, Sequence

from . import wifi_texts
from .status import OK, WARN, Kind, Status
from .wifi_texts import Station
from .windows import Rate


@dataclass(frozen=True)
class WifiState:
    """One interface. NaN: unknown."""
    interface: str = ''
    """Name of the interface; empty: there is none."""
    ssid: str = ''
    signal: float = math.nan
    """Signal level of what this side receives [dBm]."""
    noise: float = math.nan
    """Noise level [dBm]."""
    tx_bitrate: float = math.nan
    """Bit rate of what this side transmits [Mbit/s]."""
    rx_bitrate: float = math.nan
    """Bit rate of what this side receives [Mbit/s]."""
    retries: float = math.nan
    """Transmissions that are repeated [1/s]."""
    failed: float = math.nan
    """Frames that are given up after all retries [1/s]."""
    beacon_loss: float = math.nan
    """Beacons of the access point that are missed [1/s]."""
    missing: bool = False
    """Whether the interface was configured by its name, but does not exist."""


class WifiTexts(NamedTuple):
    """What was read of an interface; empty: it could not be read."""
    dev: str = ''
    """`iw dev`"""
    link: str = ''
    """`iw dev IF link`"""
    stations: str = ''
    """`iw dev IF station dump`"""
    survey: str = ''
    """`iw dev IF survey dump`"""
    wireless: str = ''
    """/proc/net/wireless"""
    arp: str = ''
    """/proc/net/arp"""


def choose_interface(wireless: Sequence[str], routes: str, peers: Sequence[str]) -> Optional[str]:
    """The interface to show: that of the route to the first peer that has a wireless one, else the only one.

    :param wireless: names of this machine's wireless interfaces
    :param routes: /proc/net/route
    :param peers: IPv4 addresses of the other side
    :return: None where it is unknown
    """
    routed = [wifi_texts.route_interface(routes, peer) for peer in peers]
    return next((name for name in routed if name in wireless), wireless[0] if len(wireless) == 1 else None)


class WifiMeter:
    """Computes the state of an interface from what is read of it, about once a second."""

    def __init__(self) -> None:
        self._of = '', ''       # interface, station
        self._rates: Dict[str, Rate] = {}

    def update(self, interface: str, texts: WifiTexts, peers: Sequence[str], now: float) -> WifiState:
        """The state of the interface now.

        :param peers: IPv4 addresses of the other side: of several stations theirs counts, else the strongest one
        """
        link = wifi_texts.link(texts.link)
        associated = link.station if link else Station()
        station = self._station(texts, peers) or associated
        row = wifi_texts.wireless_rows(texts.wireless).get(interface)
        if self._of != (interface, station.address):    # counters of another station
            self._of, self._rates = (interface, station.address), {}
        noise = wifi_texts.noise(texts.survey)
        return WifiState(
            interface, (link.ssid if link else '') or wifi_texts.ssids(texts.dev).get(interface, ''),
            row.signal if row and math.isnan(station.signal) else station.signal,
            row.noise if row and math.isnan(noise) else noise, station.tx_bitrate, station.rx_bitrate,
            self._rate('retries', station.retries, now),
            self._rate('failed', row.failed if row and station.failed is None else station.failed, now),
            self._rate('beacon loss', row.missed_beacons if row and station.beacon_loss is None
                       else station.beacon_loss, now))

    @staticmethod
    def _station(texts: WifiTexts, peers: Sequence[str]) -> Optional[Station]:
        found = wifi_texts.stations(texts.stations)
        addresses = {wifi_texts.hardware_address(texts.arp, peer) for peer in peers}
        own = [station for station in found if station.address in addresses]
        # NaN compares as False: an unknown signal never is the greater one
        strongest = sorted(own or found, key=lambda station: (station.signal > -math.inf, station.signal))
        return strongest[-1] if strongest else None

    def _rate(self, name: str, total: Optional[int], now: float) -> float:
        """The growth of a counter [1/s]; NaN: unknown."""
        rate = self._rates.setdefault(name, Rate())
        rate.read(total, now)
        return math.nan if total is None or rate.per_second is None else rate.per_second


def wifi_status(state: WifiState) -> Status:
    """The status of the Wi-Fi; - is the interface where there is none."""
    values = {'signal [dBm]': state.signal, 'noise [dBm]': state.noise, 'tx bitrate [Mbit/s]': state.tx_bitrate,
              'rx bitrate [Mbit/s]': state.rx_bitrate, 'retries [1/s]': state.retries, 'failed [1/s]': state.failed,
              'beacon loss [1/s]': state.beacon_loss}
    level, message = OK, 'fine' if state.interface else 'no wireless interface'
    if state.missing:
        level, message = WARN, 'there is no wireless interface %s' % state.interface
    return Status(Kind.WIFI, 'wifi', level, message, {
        'wifi': state.interface or '-', **({'ssid': state.ssid} if state.ssid else {}), **values})
