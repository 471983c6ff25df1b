# SPDX-License-Identifier: BSD-3-Clause
"""What a side of a link lab sends by the way back: a node there that obeys, and its Teleoperator here.

Each line on the node's standard input is a JSON list of a method of Node and its arguments; the answer is a line of
JSON. Times are time.time(): both sides are one machine [s].
"""
import concurrent.futures
import json
import pathlib
import sys
import threading
import time
from typing import Any, List, Sequence, Tuple

import rospy
from geometry_msgs.msg import Twist
from std_msgs.msg import Bool, Empty, UInt32
from std_srvs.srv import SetBool

from smokebot_udp.srv import SetFocus

from . import TOP
from .processes import Peer
from .stack import Stack
from .way_back_results import Log

COMMANDS, ESTOP, ESTOP_RELEASE = 'operator/cmd_vel', 'operator/estop', 'operator/estop_release'
RELEASE = 'operator_receiver/estop'
"""Service that releases the emergency stop, in the operator's namespace."""

SERVICE = '/operator/counted'
RATE = 20.0
"""Rate of commands [Hz]."""

ZEROS = 5
"""Number of commands that stand still, before those that drive: an interlock opens only by them."""

ANSWER = 60.0
"""Time to wait for an answer, beyond the time that is asked for [s]."""


class Teleoperator:
    """The node; end it by `close`. It needs a good link at its start: it calls the master on the other side.

    :param topics: on which it may send numbers
    :param log: for its output
    :param namespace: of the operator
    """

    def __init__(self, stack: Stack, side: str, topics: Sequence[str], log: pathlib.Path, namespace: str = '/') -> None:
        with log.open('ab') as file:
            self._peer = Peer(stack.lab.command(side, [sys.executable, '-m', __name__, *topics]), cwd=str(TOP),
                              env={**stack.environment(side), 'ROS_NAMESPACE': namespace}, stderr=file)
        assert self._peer.line() == 'ready'

    def _ask(self, *words: Any, seconds: float = 0.0) -> Any:
        return json.loads(self._peer.ask(json.dumps(words), seconds + ANSWER))

    def drive(self) -> None:
        """Publish commands from now on: first ZEROS that stand still, then numbered ones."""
        self._ask('drive')

    def rest(self) -> Log:
        """Publish none from now on; [(number, when)] of all numbered ones since the last rest."""
        sent: Log = self._ask('rest')
        return sent

    def estop(self, engaged: bool) -> float:
        """Engage or release the emergency stop; when it was published."""
        return float(self._ask('estop', engaged))

    def press(self) -> None:
        """Press the emergency stop, once there is a node that listens."""
        self._ask('press')

    def release(self) -> Tuple[bool, str]:
        """Ask for its release once: (whether it is released, in words)."""
        done, words = self._ask('release')
        return bool(done), str(words)

    def call(self, count: int, at_once: int, timeout: float) -> List[Tuple[str, float, float, str]]:
        """Call the service: [(content, from, until, what failed; empty: nothing)] of each call.

        :param timeout: of all of them [s]
        """
        called: List[Tuple[str, float, float, str]] = self._ask('call', count, at_once, seconds=timeout)
        return called

    def send(self, topic: str, count: int, rate: float) -> Log:
        """Publish the numbers from 0 on; [(number, when)]."""
        sent: Log = self._ask('send', topic, count, rate, seconds=count / rate)
        return sent

    def close(self) -> None:
        """End the node."""
        self._peer.close()


class Node:
    """Its public methods are what can be asked for."""

    def __init__(self, topics: Sequence[str]) -> None:
        self._publishers = {topic: rospy.Publisher(topic, UInt32, queue_size=100) for topic in topics}
        self._commands = rospy.Publisher(COMMANDS, Twist, queue_size=10)
        self._estop = rospy.Publisher(ESTOP, Bool, queue_size=10)
        self._released = rospy.Publisher(ESTOP_RELEASE, Empty, queue_size=1)
        self._sent: List[Tuple[int, float]] = []
        self._number = 0
        self._zeros = 0
        self._driving = False
        threading.Thread(target=self._drive, daemon=True).start()

    def _drive(self) -> None:
        due = time.monotonic()
        while not rospy.is_shutdown():
            due = wait_until(due + 1 / RATE)
            if self._driving:
                self._command()

    def _command(self) -> None:
        command = Twist()
        if self._zeros:
            self._zeros -= 1
        else:
            self._number += 1
            command.linear.x = self._number
            self._sent.append((self._number, time.time()))
        self._commands.publish(command)

    def drive(self) -> None:
        """See Teleoperator."""
        self._zeros, self._driving = ZEROS, True

    def rest(self) -> Log:
        """See Teleoperator."""
        self._driving = False
        time.sleep(1 / RATE)     # one may be on its way
        sent, self._sent = self._sent, []
        return sent

    def estop(self, engaged: bool) -> float:
        """See Teleoperator."""
        now = time.time()
        if engaged:
            self.press()
        else:
            self._released.publish()
        return now

    def press(self) -> None:
        """See Teleoperator."""
        while not self._estop.get_num_connections():
            time.sleep(1 / RATE)
        self._estop.publish(True)

    def release(self) -> Tuple[bool, str]:
        """See Teleoperator."""
        try:
            answer = rospy.ServiceProxy(RELEASE, SetBool)(False)
        except rospy.ServiceException as error:     # operator_receiver does not run
            return False, str(error)
        return answer.success, answer.message

    def call(self, count: int, at_once: int) -> List[Tuple[str, float, float, str]]:
        """See Teleoperator."""
        with concurrent.futures.ThreadPoolExecutor(at_once) as pool:
            return list(pool.map(self._call, map(str, range(count))))

    def _call(self, content: str) -> Tuple[str, float, float, str]:
        begun = time.time()
        try:
            answer = rospy.ServiceProxy(SERVICE, SetFocus)(content)
            failed = '' if answer.message == content else 'the answer is %r' % answer.message
        except rospy.ServiceException as error:
            failed = str(error) or 'no reason'
        return content, begun, time.time(), failed

    def send(self, topic: str, count: int, rate: float) -> Log:
        """See Teleoperator."""
        sent, due = [], time.monotonic()
        for number in range(count):
            due = wait_until(due + 1 / rate)
            sent.append((number, time.time()))
            self._publishers[topic].publish(UInt32(number))
        return sent


def wait_until(due: float) -> float:
    """Wait until `due` by time.monotonic(); the time then [s]."""
    time.sleep(max(0.0, due - time.monotonic()))
    return max(due, time.monotonic())


def main() -> None:
    """Run the node until its standard input ends."""
    reports, sys.stdout = sys.stdout, sys.stderr    # where rospy logs
    rospy.init_node('teleoperator', anonymous=True)     # there may be one on each side
    node = Node(rospy.myargv(sys.argv)[1:])
    reports.write('ready\n')
    reports.flush()
    for line in sys.stdin:
        name, *arguments = json.loads(line)
        reports.write(json.dumps(getattr(node, name)(*arguments)) + '\n')
        reports.flush()
    rospy.signal_shutdown('the standard input ended')


if __name__ == '__main__':
    main()
