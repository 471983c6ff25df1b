# SPDX-License-Identifier: BSD-3-Clause
"""A cable between an operator and a robot on one machine, which can be cut."""
import select
import socket
import threading
from typing import Any

PERIOD = 0.05
"""How often it is looked whether the cable has been removed [s]."""


class UdpCable:
    """Forwards datagrams between a UDP port and whoever wrote to `port` last.

    :param to: the port
    """

    def __init__(self, to: int) -> None:
        self.is_cut = False
        """Whether what comes is lost."""
        self._far_end, self._near_end = ('127.0.0.1', to), None     # type: ignore[var-annotated]
        self._near, self._far = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        for one in (self._near, self._far):
            one.bind(('127.0.0.1', 0))
        self.port: int = self._near.getsockname()[1]
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Remove the cable."""
        self._ended.set()
        self._thread.join()
        self._near.close()
        self._far.close()

    def _run(self) -> None:
        while not self._ended.is_set():
            for one in select.select([self._near, self._far], [], [], PERIOD)[0]:
                self._forward(one)

    def _forward(self, source: Any) -> None:
        data, sender = source.recvfrom(65535)
        if source is self._near:
            self._near_end = sender
        if self.is_cut:
            return
        if source is self._near:
            self._far.sendto(data, self._far_end)
        elif self._near_end is not None:
            self._near.sendto(data, self._near_end)
