# SPDX-License-Identifier: BSD-3-Clause
"""XML-RPC calls of a stranger to nodes: connections in others' names, forged notifications, questions.

    python3 -m evaluation.hostile_calls --seconds 60 --calls 10000 --seed 1 /robot_sender /operator_receiver
"""
import argparse
import random
import threading
import time
import xmlrpc.client
from typing import Any, Callable, List

import rosgraph

CALLERS = '/operator_receiver', '/robot_sender', '/stranger'
TOPICS = '/smokebot_udp/thermal/segments', '/smokebot_udp/link/segments', '/odom', '/no_such'

CALLS: List[Callable[[Any, random.Random], Any]] = [
    lambda node, chance: node.requestTopic(chance.choice(CALLERS), chance.choice(TOPICS), [['UDPROS']]),
    lambda node, chance: node.requestTopic(chance.choice(CALLERS), chance.choice(TOPICS), [
        ['UDPROS', xmlrpc.client.Binary(b'header'), '10.77.0.2', chance.randrange(1, 65536), 1472]]),
    lambda node, chance: node.publisherUpdate('/master', chance.choice(TOPICS), []),
    lambda node, chance: node.publisherUpdate('/master', chance.choice(TOPICS), ['http://10.77.0.2:1/']),
    lambda node, chance: node.getBusInfo('/stranger'),
]


def flood(uri: str, seconds: float, calls: int, seed: int) -> None:
    """Make random calls of a node, evenly over a time."""
    chance, begun = random.Random(seed), time.monotonic()
    for i in range(calls):
        time.sleep(max(0.0, begun + i * seconds / calls - time.monotonic()))
        try:
            with xmlrpc.client.ServerProxy(uri) as node:
                chance.choice(CALLS)(node, chance)
        except (OSError, xmlrpc.client.Error):
            pass    # refused


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description='Call nodes as a stranger.')
    parser.add_argument('nodes', nargs='+', help='names of nodes that the master knows')
    parser.add_argument('--seconds', type=float, default=60.0)
    parser.add_argument('--calls', type=int, default=10000)
    parser.add_argument('--seed', type=int, default=0)
    options = parser.parse_args()
    master = rosgraph.Master('/stranger')
    threads = [threading.Thread(target=flood, daemon=True, args=(
        master.lookupNode(node), options.seconds, options.calls // len(options.nodes), options.seed + i))
        for i, node in enumerate(options.nodes)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(2 * options.seconds)


if __name__ == '__main__':
    main()
