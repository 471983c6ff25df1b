# SPDX-License-Identifier: BSD-3-Clause
"""What a node and the process that decodes its video share: the layout of their memory, and the records on their pipes.

The node writes the slices of an image into the memory and a record of fixed length into a pipe; the process writes the
decoded planes into the memory and a record into the other pipe. As the records are shorter than PIPE_BUF, neither side
ever blocks while it writes. The node trusts nothing of the process, which parses bytes from the air: it checks each
record, and copies the pixels before it uses them.
"""
import enum
import struct
from typing import NamedTuple, Sequence, Tuple

from .decoder_request import MAX_BYTES, MAX_PIXELS, Request

PLANES_AT = MAX_BYTES
"""Where the planes begin: luma, and for colour both of chroma, one after the other [byte]."""

PLANES_SIZE = 4 * MAX_PIXELS
"""More than the planes of the largest image need, their lines padded; only what is written takes memory [byte]."""

SIZE = PLANES_AT + PLANES_SIZE
"""Size of the memory [byte]."""

MAX_PADDING = 1
"""Maximum padding of a side, which is padded to an even one; see planes.py [pixel]."""

PLANES = 3
"""Maximum number of planes of an image: luma and both of chroma."""

MAGIC = b'SBV\x01'
"""First bytes of each record; the last one is the version."""

COMMAND = struct.Struct('<4s6I?')
"""MAGIC and the fields of Command."""

ANSWER = struct.Struct('<4sIB5I')
"""MAGIC and the fields of Answer."""


class Status(enum.IntEnum):
    """What became of a command."""
    READY = 0
    """The process can decode. This is its first record, number 0."""
    BROKEN = 1
    """The process cannot decode, and ends. The reason is in the memory at PLANES_AT: UTF-8, up to a zero byte. This is
    its first record, too."""
    DECODED = 2
    """The planes are in the memory."""
    NOTHING = 3
    """The slices gave no image in libavcodec."""
    UNFIT = 4
    """The parameter sets are bad, or the image has another size or format than announced."""


class Command(NamedTuple):
    """One image to be decoded: a Request whose bytes are in the memory, at 0."""
    number: int
    """Number of the command, uint32. The answer repeats it."""
    session: int
    height: int
    width: int
    sets_size: int
    """Size of the parameter sets, which come first [byte]."""
    slices_size: int
    """Size of the slices with their start codes [byte]."""
    colour: bool

    def to_bytes(self) -> bytes:
        return COMMAND.pack(MAGIC, *self)

    @classmethod
    def from_bytes(cls, data: bytes) -> 'Command':
        """:raises ValueError: it is none of this version"""
        if len(data) != COMMAND.size or data[:len(MAGIC)] != MAGIC:
            raise ValueError('no command: %r' % data)
        return cls(*COMMAND.unpack(data)[1:])


class Answer(NamedTuple):
    """What became of a command."""
    number: int
    status: Status
    height: int = 0
    """Height of the luma plane [pixel]."""
    width: int = 0
    """Width of the luma plane [pixel]."""
    lines: Tuple[int, ...] = (0, 0, 0)
    """Number of bytes from one line to the next, for each plane; 0: there is no such plane."""

    def to_bytes(self) -> bytes:
        return ANSWER.pack(MAGIC, *self[:4], *self.lines)

    @classmethod
    def from_bytes(cls, data: bytes) -> 'Answer':
        """:raises ValueError: it is none of this version"""
        if len(data) != ANSWER.size or data[:len(MAGIC)] != MAGIC:
            raise ValueError('no answer: %r' % data)
        number, status, height, width, *lines = ANSWER.unpack(data)[1:]
        return cls(number, Status(status), height, width, tuple(lines))


class Plane(NamedTuple):
    """Where a plane is in the memory."""
    start: int
    """[byte]"""
    height: int
    """[pixel]"""
    width: int
    """[pixel]"""
    line: int
    """Bytes from one line to the next."""

    @property
    def end(self) -> int:
        """[byte]"""
        return self.start + self.height * self.line


def layout(height: int, width: int, lines: Sequence[int]) -> Sequence[Plane]:
    """The planes of an image of 8 bits, chroma subsampled 4:2:0.

    :param height: of luma [pixel]
    :param width: of luma [pixel]
    :param lines: bytes from one line to the next, of each plane that there is
    :raises ValueError: they do not fit the memory, or lines are shorter than their pixels
    """
    planes, start = [], PLANES_AT
    for number, line in enumerate(lines):
        half = number > 0
        plane = Plane(start, (height + half) >> half, (width + half) >> half, line)
        start = plane.end
        if line < plane.width or start > SIZE:
            raise ValueError('a plane of %d x %d pixels with lines of %d bytes' % (plane.width, plane.height, line))
        planes.append(plane)
    return planes


def check_fit(request: Request, height: int, width: int) -> None:
    """:raises ValueError: an image of this size is not the one of the request"""
    if not (request.height <= height <= request.height + MAX_PADDING
            and request.width <= width <= request.width + MAX_PADDING):
        raise ValueError('%d x %d pixels of video, announced as %d x %d' % (
            width, height, request.width, request.height))
