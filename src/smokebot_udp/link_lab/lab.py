# SPDX-License-Identifier: BSD-3-Clause
"""Two network namespaces, robot and operator, joined by an emulated link. Needs Linux and root.

The link is carried by a process of its own, see carrier.py.
"""
import json
import os
import subprocess
import sys
from types import TracebackType
from typing import Any, Dict, List, Mapping, Optional, Sequence, Type, TypeVar

from .link_trace import SIDES

ADDRESSES = {'robot': '10.77.0.1', 'operator': '10.77.0.2'}
DEVICE = 'air'
"""Name of the device on either side."""

MTU = 1500
QUEUE_LENGTH = 10000
"""Packets that the kernel holds until the carrier takes them; more than ever accumulate."""

MASTER = 'http://%s:11311' % ADDRESSES['robot']
"""The ROS master runs on the robot's side."""


Own = TypeVar('Own', bound='TwoSides')


class LabError(Exception):
    """The lab cannot be built here; the message says why."""


def side_commands(side: str, congestion_control: str) -> List[str]:
    """Arguments of `ip` that give a side's end of the link its addresses, in the side's namespace.

    :param congestion_control: of TCP
    """
    other = ADDRESSES[next(name for name in SIDES if name != side)]
    return ['link set lo up', 'addr add %s peer %s dev %s' % (ADDRESSES[side], other, DEVICE),
            'link set %s mtu %d txqueuelen %d up' % (DEVICE, MTU, QUEUE_LENGTH),
            'route replace %s dev %s src %s congctl %s' % (other, DEVICE, ADDRESSES[side], congestion_control)]


class TwoSides:
    """Runs commands in two network namespaces. A context manager.

    :param namespaces: {side: path}
    """

    def __init__(self, namespaces: Mapping[str, str]) -> None:
        self._namespaces = dict(namespaces)

    def command(self, side: str, arguments: Sequence[str]) -> List[str]:
        """The command line that runs a command on a side."""
        return ['nsenter', '--net=' + self._namespaces[side], *arguments]

    def run(self, side: str, arguments: Sequence[str], **options: Any) -> Any:
        """Run a command on a side as subprocess.run does."""
        return subprocess.run(self.command(side, arguments), **options)

    def popen(self, side: str, arguments: Sequence[str], **options: Any) -> Any:
        """Start a command on a side as subprocess.Popen does."""
        return subprocess.Popen(self.command(side, arguments), **options)

    def close(self) -> None:
        """Remove the link."""

    def __enter__(self: Own) -> Own:
        return self

    def __exit__(self, kind: Optional[Type[BaseException]], error: Optional[BaseException],
                 traceback: Optional[TracebackType]) -> None:
        self.close()


class Lab(TwoSides):
    """The link, and a way to run commands on its two sides. A context manager.

    :param seed: of the link's random effects
    :param congestion_control: of TCP, on both sides: cubic, bbr, ...
    :param shared_air: whether both directions wait for one air, first come, first served
    :raises LabError: if this process lacks the privileges, or the kernel the features
    """

    def __init__(self, seed: int = 0, congestion_control: str = 'cubic', shared_air: bool = False) -> None:
        if os.geteuid() != 0:
            raise LabError('only root can make network namespaces: run it with sudo')
        self._process = subprocess.Popen(
            [sys.executable, '-m', __package__ + '.carrier'], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.PIPE, universal_newlines=True,
            env=dict(os.environ, PYTHONPATH=os.pathsep.join(sys.path)))
        answer = self._request({'seed': seed, 'congestion_control': congestion_control, 'shared_air': shared_air})
        super().__init__({side: '/proc/%d/fd/%d' % (self._process.pid, answer[side]) for side in SIDES})

    def _request(self, message: Mapping[str, Any]) -> Dict[str, Any]:
        assert self._process.stdin and self._process.stdout and self._process.stderr
        try:
            self._process.stdin.write(json.dumps(message) + '\n')
            self._process.stdin.flush()
        except BrokenPipeError:
            pass
        line = self._process.stdout.readline()
        if not line:
            errors = self._process.stderr.read().strip().splitlines()
            raise LabError('the link ended: %s' % (errors[-1] if errors else 'exit code %r' % self._process.wait()))
        answer: Dict[str, Any] = json.loads(line)
        if 'error' in answer:
            raise ValueError(answer['error'])
        return answer

    def set(self, both: Optional[Mapping[str, Any]] = None, **sides: Mapping[str, Any]) -> None:
        """Change the conditions of the link: set({'loss': 0.3}), set(robot={'rate': 1e6}).

        :raises ValueError: naming the value that is invalid; nothing is changed then
        """
        self._request({side: {**(both or {}), **sides.get(side, {})} for side in SIDES})

    def counts(self) -> Dict[str, Any]:
        """The channels' counters.

        :return: {side: its Counts as a dict}, `late`: {p50, p99} of the packets since the last call [s], `waited`:
            {side: {time in the queue [ms]: packets}}, `flows`: {side: {'udp', 'tcp' or 'other': Counts as a dict}}
        """
        answer = self._request({})
        answer['waited'] = {side: {int(ms): count for ms, count in waited.items()}
                            for side, waited in answer['waited'].items()}
        return answer

    def statistics(self) -> Dict[str, Any]:
        """`counts`, and for each side `missed`: packets that the carrier failed to take from the kernel."""
        answer = self.counts()
        for side in SIDES:
            counters = self.run(side, ['cat', '/proc/net/dev'], stdout=subprocess.PIPE, check=True).stdout.decode()
            answer[side]['missed'] = int(counters.split(DEVICE + ':')[1].split()[11])
        return answer

    def close(self) -> None:
        assert self._process.stdin and self._process.stdout and self._process.stderr
        self._process.stdin.close()
        try:
            self._process.wait(5)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._process.stdout.close()
        self._process.stderr.close()


def environment(side: str) -> Dict[str, str]:
    """The environment variables of a ROS node on a side: those of this process, with the side's ROS_IP and the lab's
    ROS_MASTER_URI."""
    # ROS_HOSTNAME would take precedence over ROS_IP
    rest = {name: value for name, value in os.environ.items() if name != 'ROS_HOSTNAME'}
    return {**rest, 'ROS_IP': ADDRESSES[side], 'ROS_MASTER_URI': MASTER}
