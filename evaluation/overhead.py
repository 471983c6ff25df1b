# SPDX-License-Identifier: BSD-3-Clause
"""All that a link of two masters carries, as it arrives on a side's end of the lab.

    python3 -m evaluation.overhead PORT

writes a JSON line {source port: [packets, bytes]} each second: IP packets since the start. Overhead is its reader.
"""
import json
import subprocess
import sys
import threading
import time
from typing import Dict, List, Tuple

from smokebot_udp.udpros.datagram import IP_UDP_HEADERS

from . import TOP
from .stack import Stack
from .tap import datagrams, open_tap


class Overhead:
    """Counts on the operator's side."""

    def __init__(self, stack: Stack, port: int) -> None:
        self.counts: List[Tuple[float, Dict[int, List[int]]]] = []
        """(when [s], {source port: counts}), one a second."""
        process = stack.start('operator', sys.executable, '-m', __name__, str(port), cwd=str(TOP),
                              stdout=subprocess.PIPE, universal_newlines=True)
        assert process.stdout is not None
        self._lines = process.stdout
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        for line in self._lines:
            self.counts.append((time.monotonic(), {int(port): counts for port, counts in json.loads(line).items()}))

    def rate(self, port: int, seconds: float) -> float:
        """Bytes a second that came from a port in the last seconds."""
        last, now = self.counts[-1]
        first, before = next(found for found in self.counts if found[0] >= last - seconds)
        return (now[port][1] - before.get(port, [0, 0])[1]) / (last - first)


def main() -> None:
    port = int(sys.argv[1])
    counts: Dict[int, List[int]] = {}
    due = time.monotonic()
    for datagram in datagrams(open_tap(), port):
        found = counts.setdefault(datagram.source[1], [0, 0])
        found[0] += 1
        found[1] += len(datagram.payload) + IP_UDP_HEADERS
        if time.monotonic() >= due:
            due = time.monotonic() + 1.0
            print(json.dumps(counts), flush=True)


if __name__ == '__main__':
    main()
