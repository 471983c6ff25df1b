# SPDX-License-Identifier: BSD-3-Clause
"""Calls of a service of the robot: what its two sides send each other, and how a call ends.

Both sides are pure: call_client.py (operator) and call_server.py (robot). A call is executed at most once:

* Requests and answers cross in channels, which deliver each once, and repeat it until it arrives or their session ends.
  A request is sent to one session of a channel only.
* Each node has a session, a random number. A client numbers its calls from 1 on; a number is never used again.
* A request names the session of the robot's node that it is for. Another one, such as the same node after a restart,
  does not execute it and answers with its own session: then the client fails the calls that it sent to the old one.
* A request says until when it may be executed, by the robot's clock, whose time is in each answer: after a cut nothing
  is executed for a caller who has given up.

A client that does not know the robot's session asks for it with a request for session 0. It believes in another session
only if the answer is to such a question, or to a call, that it sent since it knows the present one.
"""
import struct
import zlib
from typing import NamedTuple, Optional

MAX_SIZE = 1 << 20
"""Of a serialised request or answer [byte]."""

MAX_CALLS = 32
"""Calls of a service at the same time; more are refused."""

MAX_TIMEOUT = 3600.0
"""Of a call [s]."""

MAX_TEXT = 1000
"""Of the reason of a failure [byte]."""

_REQUEST, _ANSWER = 0xc1, 0xc2      # the first byte
_REQUEST_HEADER = struct.Struct('<BIIIIQ')
_ANSWER_HEADER = struct.Struct('<BIIIQB')

WELCOME, ANSWERED, FAILED = range(3)
"""Kinds of answers: the robot's session; the service's response; the reason of a failure."""


class Outcome(NamedTuple):
    """How a call ended."""
    data: bytes = b''
    """The serialised response."""
    failure: Optional[str] = None
    """Why there is none; None: there is one."""


class Request(NamedTuple):
    """A call on its way to the robot."""
    client: int
    """Session of the operator's node."""
    server: int
    """Session of the robot's node that may execute it; 0: it asks for the session."""
    number: int
    """Of the call, or of the question for the session; from 1 on."""
    checksum: int
    """See type_checksum."""
    until: float
    """When nobody waits for the answer any more, by the steady clock of the robot's node [s]."""
    data: bytes
    """The serialised request."""

    def pack(self) -> bytes:
        return _REQUEST_HEADER.pack(_REQUEST, self.client, self.server, self.number, self.checksum,
                                    _microseconds(self.until)) + self.data


class Answer(NamedTuple):
    """The answer to a Request."""
    client: int
    server: int
    """Session of the robot's node that sends it."""
    number: int
    clock: float
    """When it answers, by its steady clock [s]."""
    kind: int
    """WELCOME, ANSWERED or FAILED."""
    data: bytes = b''
    """The serialised response, or the reason of a failure in UTF-8."""

    def pack(self) -> bytes:
        return _ANSWER_HEADER.pack(_ANSWER, self.client, self.server, self.number, _microseconds(self.clock),
                                   self.kind) + self.data

    @property
    def outcome(self) -> Outcome:
        if self.kind == ANSWERED:
            return Outcome(self.data)
        return Outcome(failure=self.data[:MAX_TEXT].decode('utf-8', 'replace') or 'no reason is given')


def answer_to(request: Request, server: int, clock: float, outcome: Outcome) -> Answer:
    """The answer of the robot's node of session `server`."""
    if outcome.failure is None:
        return Answer(request.client, server, request.number, clock, ANSWERED, outcome.data)
    return Answer(request.client, server, request.number, clock, FAILED, outcome.failure.encode()[:MAX_TEXT])


def unpack_request(data: bytes) -> Optional[Request]:
    """The request in a message; None: it is none."""
    if not _REQUEST_HEADER.size <= len(data) <= _REQUEST_HEADER.size + MAX_SIZE:
        return None
    kind, client, server, number, checksum, until = _REQUEST_HEADER.unpack_from(data)
    if kind != _REQUEST or not client or not number:
        return None
    return Request(client, server, number, checksum, until / 1e6, data[_REQUEST_HEADER.size:])


def unpack_answer(data: bytes) -> Optional[Answer]:
    """The answer in a message; None: it is none."""
    if not _ANSWER_HEADER.size <= len(data) <= _ANSWER_HEADER.size + MAX_SIZE:
        return None
    kind, client, server, number, clock, answer = _ANSWER_HEADER.unpack_from(data)
    if kind != _ANSWER or not server or answer > FAILED or (answer != WELCOME and not number):
        return None
    return Answer(client, server, number, clock / 1e6, answer, data[_ANSWER_HEADER.size:])


def _microseconds(seconds: float) -> int:
    return int(1e6 * max(seconds, 0.0))


def type_checksum(type_name: str, md5sum: str) -> int:
    """What both sides compare: the CRC-32 of a service's type and md5 sum."""
    return zlib.crc32(('%s %s' % (type_name, md5sum)).encode())
