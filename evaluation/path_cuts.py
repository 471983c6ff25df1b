# SPDX-License-Identifier: BSD-3-Clause
"""Cuts the preferred one of a robot's two addresses again and again.

    sudo ./smokebot exec python3 -m evaluation.path_cuts [--cuts 50] [--seconds 5] [--loss 0.0]
                                                        [--one | --by-hand]

Own masters, sealed, the nodes and streams as shipped. The first link has 2 Mbit/s and 10 ms each way, the second one
1 Mbit/s and 30 ms. Each cut begins at a random moment. It prints an object in JSON: of each topic the longest time
without a message around each cut, and of images the highest age of the newest one. COMMAND is what the robot gets of a
Twist that the desk publishes RATE times a second.

For comparison, --one: the desk is given the first address only. --by-hand: likewise, and an operator notices each cut
and its end after REACTION, and starts the receiver with the other address.
"""
import argparse
import json
import os
import random
import time
from typing import Any, Dict, List, Sequence

import numpy as np

from smokebot_udp.demo.link import FIRST_OF_TWO, SECOND_OF_TWO
from smokebot_udp.link_lab.lab import ADDRESSES as HOSTS
from smokebot_udp.link_lab.second_link import SECOND, SECOND_DEVICE, second_lab

from . import processes
from .listener import Heard, Listener
from .own_masters import PORT, ROBOT, OwnMasters
from .started import Started

ADDRESSES = ROBOT, '%s:%d' % (SECOND['robot'], PORT)
TOPICS = {'/operator/thermal/image_raw': 'image', '/operator/camera/image_raw': 'image', '/operator/odom': 'odometry'}
COMMAND, RATE = '/cmd_vel', 20
GAP, AGE = 'gap', 'age'
TWIST = '[0.2, 0, 0]', '[0, 0, 0]'
SETTLED = 8.0
"""Until the rate fits the link [s]."""

REACTION = 3.0
"""Time until an operator who switches by hand has seen that a link is cut, or back [s]."""

RESTART_TIMEOUT = 60.0
"""A receiver by which nothing has come by then never will get anything [s]."""

AROUND = 1.0
"""Messages count from this time before a cut until this time after it [s]."""


class PathCuts(Started):
    """The nodes, and both links; a context manager.

    :param addresses: of the robot
    :param loss: of both links
    :param sender: arguments of robot_sender
    :param one_address: whether the desk has one address for both links, as in a network behind a router
    :param by_hand: whether an operator switches between ADDRESSES; `addresses` is the first one then
    :raises LabError: as Lab
    """

    def __init__(self, addresses: Sequence[str] = ADDRESSES, loss: float = 0.0, log: Any = None,
                 sender: Sequence[str] = (), one_address: bool = False, by_hand: bool = False) -> None:
        super().__init__()
        self._by_hand = by_hand
        with self.starting():
            self.stack = self.enter_context(OwnMasters(7, log))
            self.second = self.enter_context(second_lab(self.stack.lab, 8))
            self.first, self.other = {**FIRST_OF_TWO, 'loss': loss}, {**SECOND_OF_TWO, 'loss': loss}
            if one_address:
                desk = HOSTS['operator']
                self.stack.ip('operator', 'route replace %s dev %s src %s' % (SECOND['robot'], SECOND_DEVICE, desk))
                self.stack.ip('robot', 'route add %s dev %s metric 100' % (desk, SECOND_DEVICE))
            self.stack.lab.set(self.first)
            self.second.set(self.other)
            self.stack.start_node('robot', 'simulated_robot', '_width:=320', '_height:=240')
            self.stack.start_sender(*sender)
            self.stack.wait_for_port()
            self._receiver = self.stack.start_receiver(robot=','.join(addresses))
            self.operator = Listener(self.stack)
            self.operator.subscribe([[topic, kind, 'TCPROS'] for topic, kind in TOPICS.items()])
            self.robot = Listener(self.stack, 'robot')
            self.robot.subscribe([[COMMAND, 'twist', 'TCPROS']])
            missing = set(TOPICS) - set(self.operator.first(TOPICS, 60.0))
            if missing:
                raise RuntimeError('nothing comes on %s' % ', '.join(sorted(missing)))

    def drive(self) -> None:
        """Publish commands from now on.

        :raises RuntimeError: where none comes
        """
        self.stack.start('operator', 'rostopic', 'pub', '-r', str(RATE), '/operator' + COMMAND, 'geometry_msgs/Twist',
                         *TWIST)
        if not self.robot.first([COMMAND], 30.0, counts=lambda heard: heard.amount > 0):
            raise RuntimeError('no command comes')

    def cut(self, seconds: float) -> Dict[str, List[Heard]]:
        """Cut the first link for a time; what came meanwhile, and AROUND it: {topic: messages}."""
        begun = time.time()
        self.stack.lab.set({**self.first, 'loss': 1.0})
        if self._by_hand:
            self._switch(ADDRESSES[1])
        time.sleep(max(0.0, begun + seconds - time.time()))
        self.stack.lab.set(self.first)
        if self._by_hand:
            self._switch(ADDRESSES[0])
            self._await_all()
        time.sleep(AROUND)
        return self._heard_since(begun - AROUND)

    def _heard_since(self, begun: float) -> Dict[str, List[Heard]]:
        heard = [one for listener in (self.operator, self.robot) for one in list(listener.heard)
                 if one.arrival >= begun and (one.topic != COMMAND or one.amount > 0)]
        return {topic: [one for one in heard if one.topic == topic] for topic in (*TOPICS, COMMAND)}

    def _switch(self, address: str) -> None:
        """End the receiver after REACTION, and start it with another address."""
        time.sleep(REACTION)
        processes.end(self._receiver)
        self.stack.end(self._receiver)
        self._receiver = self.stack.start_receiver(robot=address)

    def _await_all(self) -> None:
        """Wait until something comes on each topic.

        :raises RuntimeError: where it does not
        """
        begun, deadline = time.time(), time.monotonic() + RESTART_TIMEOUT
        while not all(self._heard_since(begun).values()):
            if time.monotonic() > deadline:
                raise RuntimeError('not everything comes again')
            time.sleep(0.1)

    def idle_rate(self, seconds: float) -> float:
        """What the second link carries each way while the first one is good, the larger number [byte/s]."""
        before = self.second.counts()
        time.sleep(seconds)
        after = self.second.counts()
        return float(max(after[side]['carried'] - before[side]['carried'] for side in ('robot', 'operator')) / seconds)


def longest_gap(heard: Sequence[Heard]) -> float:
    """The longest time from one message to the next [s]; infinite where there are no two."""
    return float(np.diff([one.arrival for one in heard]).max()) if len(heard) > 1 else float('inf')


def oldest(heard: Sequence[Heard]) -> float:
    """The highest age of the newest message just before the next one comes [s]; NaN where they have no stamps."""
    return max((later.arrival - one.arrival + one.age for one, later in zip(heard, heard[1:])), default=float('inf'))


def cut_again(cuts: int, seconds: float, loss: float = 0.0, one: bool = False, by_hand: bool = False) -> Dict[str, Any]:
    """Cut the first link at random moments.

    :param seconds: how long, each time
    :param loss: of both links
    :param one: whether the desk has the first address only
    :param by_hand: likewise, and an operator switches to the other one
    :return: {'gap', 'age': {topic: of each cut [s]}, 'idle', 'driven': what the second link carries while the first one
        is good, without and with commands [byte/s]}
    """
    moments, found = random.Random(1), {name: {topic: [] for topic in (*TOPICS, COMMAND)} for name in (GAP, AGE)
                                        }   # type: Any, Dict[str, Dict[str, List[float]]]
    with PathCuts(ADDRESSES[:1] if one or by_hand else ADDRESSES, loss, by_hand=by_hand) as run:
        time.sleep(SETTLED)
        idle = run.idle_rate(5.0)
        run.drive()
        driven = run.idle_rate(5.0)
        for _ in range(cuts):
            time.sleep(SETTLED + moments.random())
            for topic, heard in run.cut(seconds).items():
                found[GAP][topic].append(longest_gap(heard))
                found[AGE][topic].append(oldest(heard))
    return {**found, 'idle': idle, 'driven': driven}


def spread(values: Sequence[float]) -> List[float]:
    """Median, 95th percentile and most, rounded [s]."""
    return [round(float(np.percentile(values, part)), 2) for part in (50, 95, 100)]


def main() -> None:
    parser = argparse.ArgumentParser(description="Cuts one of a robot's two addresses.")
    parser.add_argument('--cuts', type=int, default=50)
    parser.add_argument('--seconds', type=float, default=5.0, help='of each cut')
    parser.add_argument('--loss', type=float, default=0.0, help='of both links')
    given = parser.add_mutually_exclusive_group()
    given.add_argument('--one', action='store_true', help='with the first address only')
    given.add_argument('--by-hand', action='store_true', help='an operator switches between the addresses')
    found = cut_again(**vars(parser.parse_args()))
    rows = {topic: {name: spread(found[name][topic]) for name in (GAP, AGE)} for topic in (*TOPICS, COMMAND)}
    print(json.dumps({'p50, p95, most [s]': rows, 'idle [byte/s]': round(found['idle']),
                      'idle while commands come [byte/s]': round(found['driven']), 'load': os.getloadavg()[0]}))


if __name__ == '__main__':
    main()
