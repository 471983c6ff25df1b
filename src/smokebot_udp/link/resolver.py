# SPDX-License-Identifier: BSD-3-Clause
"""Finds the IPv4 address of a host name without waiting for it: the answer may take many seconds on a bad link."""
import socket
import threading
from typing import Optional

PERIOD = 5.0
"""Between two questions [s]."""


class Resolver:
    """The address of one host.

    :param host: name or numeric IPv4 address
    """

    def __init__(self, host: str) -> None:
        self.host = host
        self.address: Optional[str] = None
        """As found last; None: nothing yet."""
        self.problem: Optional[str] = None
        """Why it is not known, in one sentence; None: it is known, or was not asked for yet."""
        self._due = 0.0
        self._thread: Optional[threading.Thread] = None
        try:
            socket.inet_pton(socket.AF_INET, host)
            self.address = host
        except (OSError, ValueError):
            pass        # a name

    def poll(self, wanted: bool, now: float) -> None:
        """Ask, in a thread of its own, if that is due.

        :param wanted: whether a newer answer would help
        :param now: by a steady clock [s]
        """
        if self.address == self.host or not wanted or now < self._due or (self._thread and self._thread.is_alive()):
            return
        self._due = now + PERIOD
        self._thread = threading.Thread(target=self._ask, name='resolver', daemon=True)
        self._thread.start()

    def _ask(self) -> None:
        try:
            found = socket.getaddrinfo(self.host, None, socket.AF_INET, socket.SOCK_DGRAM)
            self.address, self.problem = str(found[0][4][0]), None
        except (OSError, ValueError) as error:      # ValueError: not a name, such as one with a label of 64 characters
            self.problem = 'the robot\'s host %r does not resolve%s: %s' % (
                self.host, ' to an IPv4 address, which the link needs' * _has_ipv6(self.host), error)


def _has_ipv6(host: str) -> bool:
    """Whether a name has an address of the other kind."""
    try:
        return bool(socket.getaddrinfo(host, None, socket.AF_INET6, socket.SOCK_DGRAM))
    except (OSError, ValueError):
        return False
