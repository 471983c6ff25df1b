# SPDX-License-Identifier: BSD-3-Clause
"""The second byte of IP headers, by which networks serve some datagrams before others and announce congestion.

Its upper six bits are the DSCP (RFC 2474). Wi-Fi (EDCA) has four queues, chosen by them: of Linux's mapping (UP = DSCP
/ 8) and of RFC 8325's, only EXPEDITED and IMAGES are in the queues for voice and video in both, and nothing is in the
one for background, as AF11 and AF21 would be in the former. A network without such queues ignores them.

The lower two are ECN (RFC 3168): a queue marks datagrams that have ECT instead of dropping them.
"""

EXPEDITED = 46 << 2
"""EF (RFC 3246): commands, the emergency stop, short states, reports and the link's own messages. There are few."""

IMAGES = 34 << 2
"""AF41 (RFC 2597)."""

SENSORS = 26 << 2
"""AF31: clouds, scans, maps and long messages."""

BULK = 0
"""Best effort: captures, logs, diagnostics."""

ECT = 0x02
"""ECT(0): whoever sends it reacts to the marks. Only the streams do, by their reports."""

CE = ECN = 0x03
"""Congestion experienced; and the bits of ECN."""

DSCP = 0xfc

INTERACTIVE = 6
"""TC_PRIO_INTERACTIVE of linux/pkt_sched.h: pfifo_fast and prio send it first."""


def mask(dscp: bool, ecn: bool) -> int:
    """The bits that are set, of those that are asked for."""
    return DSCP * dscp | ECN * ecn


def priority(tos: int) -> int:
    """SO_PRIORITY (socket(7)) for this machine's own queues.

    Linux derives it from the byte as RFC 1349 had it, and would send AF41 after everything else.
    """
    return INTERACTIVE if tos & DSCP == EXPEDITED else 0
