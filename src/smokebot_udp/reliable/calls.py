# SPDX-License-Identifier: BSD-3-Clause
"""Calls of a service of the robot: what its two sides send each other, and how a call ends.

Both sides are pure: call_client.py (operator) and call_server.py (robot). A call is executed at most once:

* Requests and answers cross in channels, which deliver each once, and repeat it until it arrives or their session ends.
  A request is sent to one node, in one session: what waits in a channel when that ends is given up.
* Calls are numbered from a random number on; a number is never used again, so no answer belongs to two calls.
* A request says until when it may be executed, by the robot's clock, whose time is in each answer: after a cut nothing
  is executed for a caller who has given up.

In each session the client first greets the robot: a request with the number GREETING, whose answer has the robot's
clock. A robot that does not have the channel says so.
"""
import struct
import zlib
from typing import NamedTuple, Optional

MAX_SIZE = 1 << 20
"""Size of a serialised request or answer, at most [byte]."""

MAX_CALLS = 32
"""Calls of a service at the same time; more are refused."""

MAX_TIMEOUT = 3600.0
"""Timeout of a call, at most [s]."""

MAX_TEXT = 1000
"""Length of the reason of a failure, at most [byte]."""

MAX_TIME = 1e12
"""Reading of a clock, at most [s]."""

GREETING = 0
"""Number of a request that is no call."""

_REQUEST = struct.Struct('<QIQ')
_ANSWER = struct.Struct('<QQ?')


class Outcome(NamedTuple):
    """How a call ended."""
    data: bytes = b''
    """The serialised response."""
    failure: Optional[str] = None
    """Why there is none; None: there is one."""


class Request(NamedTuple):
    """A call on its way to the robot."""
    number: int
    checksum: int
    """See type_checksum."""
    until: float
    """When nobody waits for the answer any more, by the steady clock of the robot's node [s]."""
    data: bytes
    """The serialised request."""

    def pack(self) -> bytes:
        return _REQUEST.pack(self.number, self.checksum, _microseconds(self.until)) + self.data


class Answer(NamedTuple):
    """The answer to a Request."""
    number: int
    clock: float
    """When the robot's node answers, by its steady clock [s]."""
    outcome: Outcome

    def pack(self) -> bytes:
        data, failure = self.outcome
        return _ANSWER.pack(self.number, _microseconds(self.clock), failure is not None) + (
            data if failure is None else failure.encode()[:MAX_TEXT])


def unpack_request(data: bytes) -> Optional[Request]:
    """The request in a message; None: it is none."""
    if not _REQUEST.size <= len(data) <= _REQUEST.size + MAX_SIZE:
        return None
    number, checksum, until = _REQUEST.unpack_from(data)
    return Request(number, checksum, until / 1e6, data[_REQUEST.size:])


def unpack_answer(data: bytes) -> Optional[Answer]:
    """The answer in a message; None: it is none."""
    if not _ANSWER.size <= len(data) <= _ANSWER.size + MAX_SIZE:
        return None
    number, clock, failed = _ANSWER.unpack_from(data)
    data = data[_ANSWER.size:]
    failure = data[:MAX_TEXT].decode('utf-8', 'replace') or 'no reason is given'
    return Answer(number, clock / 1e6, Outcome(failure=failure) if failed else Outcome(data))


def _microseconds(seconds: float) -> int:
    return int(1e6 * min(max(seconds, 0.0), MAX_TIME))


def type_checksum(type_name: str, md5sum: str) -> int:
    """What both sides compare: the CRC-32 of a service's type and md5 sum."""
    return zlib.crc32(('%s %s' % (type_name, md5sum)).encode())
