# SPDX-License-Identifier: BSD-3-Clause
"""Whatever a link does to segments, and whoever is restarted: no message is delivered twice, or out of order."""
from typing import Dict, List, Set

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule
from reliable_sides import DOWN, ROOM, UP, Link

from smokebot_udp.reliable.bounds import Bounds

CHANNELS = {UP: {'bounds': Bounds(8, 5 * ROOM, 5.0)}, DOWN: {'ordered': False, 'bounds': Bounds(8, 5 * ROOM, 5.0)}}


class Restarts(RuleBasedStateMachine):
    """A robot and an operator; all messages differ."""

    def __init__(self) -> None:
        super().__init__()
        self.link = Link(channels=CHANNELS, jitter=0.1)
        self.count = 0
        self.lives: Dict[int, List[List[bytes]]] = {UP: [self.link.robot.got[UP]], DOWN: [self.link.desk.got[DOWN]]}

    @rule(channel=st.sampled_from([UP, DOWN]), size=st.sampled_from([0, 10, ROOM, ROOM + 1, 4 * ROOM]))
    def send(self, channel: int, size: int) -> None:
        self.count += 1
        self.link.send(channel, b'%09d' % self.count + bytes(size))

    @rule(seconds=st.sampled_from([0.001, 0.02, 0.1, 0.5, 2.0, 10.0, 70.0]))
    def wait(self, seconds: float) -> None:
        self.link.run(seconds)

    @rule(loss=st.sampled_from([0.0, 0.3, 0.9, 1.0]), duplicates=st.sampled_from([0.0, 0.5]))
    def weather(self, loss: float, duplicates: float) -> None:
        self.link.loss, self.link.duplicates = loss, duplicates

    @rule(name=st.sampled_from(['robot', 'desk']))
    def restart(self, name: str) -> None:
        self.link.restart(name)
        channel = UP if name == 'robot' else DOWN
        self.lives[channel].append(self.link.nodes[name].got[channel])

    @rule(name=st.sampled_from(['robot', 'desk']), connected=st.booleans())
    def connect(self, name: str, connected: bool) -> None:
        self.link.connect(name, connected)

    @rule()
    def replay(self) -> None:
        """All that was ever on the air arrives once more, shuffled."""
        everything = list(self.link.seen)
        self.link.random.shuffle(everything)
        for name, segment in everything[:300]:
            self.link.deliver(name, segment)

    @invariant()
    def nothing_twice_nor_out_of_order(self) -> None:
        for channel, lives in self.lives.items():
            delivered = [int(message[:9]) for life in lives for message in life]
            seen: Set[int] = set(delivered)
            assert len(seen) == len(delivered)
            if channel == UP:
                assert all(life == sorted(life) for life in ([int(one[:9]) for one in life] for life in lives))

    @invariant()
    def bounded(self) -> None:
        assert self.link.desk.peers.waiting(UP) <= 8
        assert self.link.robot.peers.waiting(DOWN) <= 8

    def teardown(self) -> None:
        """In the end all that is sent anew arrives."""
        self.link.loss = self.link.duplicates = 0.0
        for name in ('robot', 'desk'):
            self.link.connect(name, True)
        self.link.run(10.0)
        for channel, node in ((UP, 'robot'), (DOWN, 'desk')):
            self.link.send(channel, b'999999999')
            self.link.run(2.0)
            assert self.link.nodes[node].got[channel][-1:] == [b'999999999'], channel


TestRestarts = Restarts.TestCase
TestRestarts.settings = settings(max_examples=60, stateful_step_count=40, deadline=None)
