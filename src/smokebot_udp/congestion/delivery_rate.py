# SPDX-License-Identifier: BSD-3-Clause
"""What datagrams that arrived tell of the rate that the air carries: at least, and while it was busy.

As in draft-cheng-iccrg-delivery-rate-estimation, but a queue that is seen takes the place of marks for
"application-limited".
"""
from typing import List, Tuple

import numpy as np

from .feedback import PacketSample
from .shaper import Passed

BUSY_DELAY = 0.002
"""A datagram delayed longer was queued: the air was busy [s]."""


def busy_period(chain: List[PacketSample], waits: List[float], noise: float, capacity: float,
                bucket: bool = False) -> Tuple[int, float]:
    """What the air carried while it was busy: (bytes, seconds).

    It was busy between two datagrams if the later one was queued, and the earlier one still was when the later one was
    sent, or was on the air where none was sent between them. Behind a token bucket the earlier one must have been
    queued, too: else the last tokens let a part of the later one pass.

    :param chain: in sending order
    :param waits: queueing delay of each [s]
    :param noise: of these delays [s]
    :param capacity: as known [byte/s]
    :param bucket: whether there is a token bucket on the path
    """
    carried, busy, queued = 0, 0.0, BUSY_DELAY + noise
    for before, after, wait_before, wait_after in zip(chain, chain[1:], waits, waits[1:]):
        unqueued = after.sent - before.sent - wait_before
        adjacent = after.total - before.total == after.size
        on_air = before.size / capacity if adjacent else 0.0
        if wait_after > queued and unqueued < on_air and (wait_before > queued or not bucket):
            carried += after.total - before.total
            busy += after.arrived - before.arrived
    return carried, busy


def peak_rate(passed: List[Passed], noise: float) -> float:
    """The highest delivery rate between any two datagrams, less what a token bucket let pass at once [byte/s]; 0: none
    is certain.

    The receiver may have read the first of the two late, with others, rather than that it was queued. It came off the
    air no earlier than it could have without a queue, and than the sample before it was read, as both were read apart.
    The interval begins there. So on a link that keeps the order the rate is never beyond the link's.

    :param passed: in sending order
    :param noise: uncertainty of intervals, for reasons other than the rate [s]
    """
    sent, arrived, total, size, wait, tokens = np.array([
        (one.sample.sent, one.sample.arrived, one.sample.total, one.sample.size, one.wait, one.tokens)
        for one in passed]).reshape(-1, 6).T
    first, last = np.triu_indices(len(passed), 1)
    carried = total[last] - total[first] - tokens[first]
    held = np.minimum(wait - noise, np.diff(arrived, prepend=-np.inf)).clip(0)
    interval = np.maximum(sent[last] - sent[first], arrived[last] - (arrived - held)[first]) + noise
    certain = (carried >= 2 * size.max(initial=0)) & (interval > 1e-4)
    return float(np.max(carried[certain] / interval[certain], initial=0.0))
