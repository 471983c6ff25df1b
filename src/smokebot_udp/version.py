# SPDX-License-Identifier: BSD-3-Clause
"""The release of this package, and the number of its wire format: all that crosses the link (doc/wire_format.md).

The number changes only where the same bytes mean something else than before, so that releases of one number work
together in any mixture. Each side says both to the other one, by either transport.
"""
from typing import Dict, Mapping, NamedTuple

RELEASE = '0.1.0'
"""Release of this package, as in package.xml."""

WIRE_FORMAT = 4
"""Number of the wire format. As long as golden files have this number, tools/golden.py refuses to write them anew."""

MAX_RELEASE = 20
"""Maximum length of the name of a release [byte of ASCII]."""

FORMAT_FIELD, RELEASE_FIELD = 'wire_format', 'smokebot_udp'
"""Fields of UDPROS's connection headers. A peer without them is another program."""

CANNOT_TALK = 'and these cannot talk to each other'
"""Text by which a peer's sentence is recognised."""


class Software(NamedTuple):
    """What one side runs."""
    wire_format: int
    release: str = ''
    """Empty: unknown."""

    def __str__(self) -> str:
        return 'smokebot_udp %s (wire format %d)' % (self.release or 'of an unknown release', self.wire_format)


OURS = Software(WIRE_FORMAT, RELEASE)


def printable(text: str) -> str:
    """The name of a release as a peer gives it; empty: it is none."""
    return text if len(text) <= MAX_RELEASE and text.isascii() and text.isprintable() else ''


def difference(first: str, its: Software, second: str, other: Software) -> str:
    """What two sides of different wire formats are told, in one sentence, the same on both sides.

    :param first, second: who they are
    """
    if its.wire_format > other.wire_format:
        first, its, second, other = second, other, first, its
    return '%s has %s, %s has %s, %s: install the newer release for %s, too' % (
        first, its, second, other, CANNOT_TALK, first)


def headers() -> Dict[str, str]:
    """The fields of this side's connection headers."""
    return {FORMAT_FIELD: str(OURS.wire_format), RELEASE_FIELD: OURS.release}


def from_headers(fields: Mapping[str, str]) -> Software:
    """What a peer with such fields runs; a number that is none is 0.

    :param fields: with FORMAT_FIELD
    """
    number = fields[FORMAT_FIELD]
    wire_format = int(number) if number.isascii() and number.isdigit() and len(number) < 9 else 0
    return Software(wire_format, printable(fields.get(RELEASE_FIELD, '')))
