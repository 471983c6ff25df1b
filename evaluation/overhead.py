# SPDX-License-Identifier: BSD-3-Clause
"""What a link of two masters carries besides the data of some topics, as it arrives on a side's end of the lab.

    python3 -m evaluation.overhead PORT ID ...

writes a JSON line {source port: [packets, bytes of the topics with these connection ids, bytes of all others]} each
second: IP packets since the start. The link must have no key. Overhead is its reader.
"""
import json
import subprocess
import sys
import threading
import time
from typing import Any, Dict, List, Sequence, Tuple

from smokebot_udp.link.packets import OVERHEAD, Kind, Mode
from smokebot_udp.link.tables import ID, Topic
from smokebot_udp.udpros.datagram import IP_UDP_HEADERS

from . import TOP
from .stack import Stack
from .tap import datagrams, open_tap

HEAD = OVERHEAD[Mode.OPEN]


class Overhead:
    """Counts on the operator's side.

    :param topics: that are no overhead
    """

    def __init__(self, stack: Stack, port: int, topics: Sequence[Topic]) -> None:
        self.counts: List[Tuple[float, Dict[int, List[int]]]] = []
        """(when [s], {source port: counts}), one a second."""
        ids = [str(topic.id) for topic in topics]
        process = stack.start('operator', sys.executable, '-m', __name__, str(port), *ids, cwd=str(TOP),
                              stdout=subprocess.PIPE, universal_newlines=True)
        assert process.stdout is not None
        self._lines = process.stdout
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        for line in self._lines:
            self.counts.append((time.monotonic(), {int(port): counts for port, counts in json.loads(line).items()}))

    def rates(self, port: int, seconds: float) -> Tuple[float, float]:
        """(bytes of the topics, bytes of all others) a second that came from a port in the last seconds."""
        last, now = self.counts[-1]
        first, before = next(found for found in self.counts if found[0] >= last - seconds)
        return tuple((after - earlier) / (last - first) for after, earlier in zip(     # type: ignore[return-value]
            now[port][1:], before.get(port, [0, 0, 0])[1:]))


def main() -> None:
    port, ids = int(sys.argv[1]), set(map(int, sys.argv[2:]))
    counts: Dict[int, List[int]] = {}
    due = time.monotonic()
    for datagram in datagrams(open_tap(), port):
        payload: Any = datagram.payload
        found = counts.setdefault(datagram.source[1], [0, 0, 0])
        found[0] += 1
        of_topics = (len(payload) >= HEAD + ID.size and payload[0] == Kind.DATA
                     and ID.unpack_from(payload, HEAD)[0] in ids)
        found[1 if of_topics else 2] += len(payload) + IP_UDP_HEADERS
        if time.monotonic() >= due:
            due = time.monotonic() + 1.0
            print(json.dumps(counts), flush=True)


if __name__ == '__main__':
    main()
