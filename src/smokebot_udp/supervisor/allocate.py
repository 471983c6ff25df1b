# SPDX-License-Identifier: BSD-3-Clause
"""Who gets how much of the link."""

DATAGRAM_TAKES, LEAST_DATAGRAM = 0.015, 400
"""A datagram is to take so long of the link at most [s], but is no shorter than this [byte]."""


def datagram_size(rate, most):
    """How long datagrams had better be: on a slow link short ones, for who waits behind them [byte].

    :param rate: of the link [byte/s]
    :param most: where the link is fast [byte]
    """
    return int(min(most, max(LEAST_DATAGRAM, rate * DATAGRAM_TAKES)))
