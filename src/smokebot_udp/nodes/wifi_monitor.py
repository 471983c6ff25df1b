# SPDX-License-Identifier: BSD-3-Clause
"""Reads the state of the Wi-Fi interface once a second, by iw and from /proc/net; see monitoring/wifi.py.

Nothing is executed on a machine without a wireless interface. Without iw there is what /proc/net/wireless has.
"""
import contextlib
import os
import socket
import subprocess
import time
from typing import Callable, Iterable, List, Optional

from ..monitoring.wifi import WifiMeter, WifiState, WifiTexts, choose_interface
from .logging import log_error
from .worker import PeriodicWorker

PERIOD = 1.0
"""Interval at which the state is updated [s]."""

TIMEOUT = 1.0
"""Limit of one call of iw: a driver may hang [s]."""

MAX_TEXT = 1 << 18
"""Maximum size of what is read of an output or a file: an access point may have hundreds of stations [byte]."""


class WifiMonitor:
    """Keeps the state of the interface up to date; lives as long as its node.

    :param peers: f() -> hosts of the other side, names or addresses
    :param interface: the parameter ~wifi_interface; empty: chosen by the route to the peers
    :param root: directory that has /sys and /proc
    """

    def __init__(self, peers: Callable[[], Iterable[str]], interface: str, root: str = '/') -> None:
        self._peers, self._forced, self._root = peers, interface, root
        self._meter = WifiMeter()
        self.state = WifiState()
        """The last state; any thread."""
        self._worker = PeriodicWorker('wifi', self.update, log_error('the state of the Wi-Fi'), PERIOD)

    def start(self) -> None:
        """Update the state from now on."""
        self._worker.wake()
        self._worker.start()

    def update(self) -> None:
        """Read the state now."""
        self.state = self._read()

    def _read(self) -> WifiState:
        wireless = self._interfaces()
        if self._forced and self._forced not in wireless:
            return WifiState(self._forced, missing=True)
        if not wireless:
            return WifiState()
        peers = [address for address in map(_address, self._peers()) if address]
        name = self._forced or choose_interface(wireless, self._file('proc/net/route'), peers)
        if name is None:
            return WifiState()
        texts = WifiTexts(_iw(), _iw(name, 'link'), _iw(name, 'station', 'dump'), _iw(name, 'survey', 'dump'),
                          self._file('proc/net/wireless'), self._file('proc/net/arp'))
        return self._meter.update(name, texts, peers, time.monotonic())

    def _interfaces(self) -> List[str]:
        """The names of this machine's wireless interfaces."""
        path = os.path.join(self._root, 'sys/class/net')
        with contextlib.suppress(OSError):
            return sorted(name for name in os.listdir(path)
                          if any(os.path.exists(os.path.join(path, name, mark)) for mark in ('phy80211', 'wireless')))
        return []

    def _file(self, name: str) -> str:
        """The content of a file; empty where it cannot be read."""
        with contextlib.suppress(OSError), open(os.path.join(self._root, name), errors='replace') as file:
            return file.read(MAX_TEXT)
        return ''

    def close(self) -> None:
        self._worker.close()


def _iw(*arguments: str) -> str:
    """The output of `iw dev ARGUMENTS`; empty where it fails or is not installed."""
    # /usr/sbin is not in the PATH of every user
    path = os.pathsep.join([os.environ.get('PATH', os.defpath), '/usr/sbin', '/sbin'])
    with contextlib.suppress(OSError, subprocess.SubprocessError):
        done = subprocess.run(('iw', 'dev', *arguments), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                              stderr=subprocess.DEVNULL, timeout=TIMEOUT, check=False,
                              env={**os.environ, 'PATH': path, 'LC_ALL': 'C'})
        return done.stdout[:MAX_TEXT].decode(errors='replace')
    return ''


def _address(host: str) -> Optional[str]:
    """The IPv4 address of a host; None: it has none."""
    with contextlib.suppress(OSError):
        return socket.gethostbyname(host)
    return None
