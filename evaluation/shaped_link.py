# SPDX-License-Identifier: BSD-3-Clause
"""A link between two network namespaces whose rate is limited by a kernel's shaper, or by the link lab.

The kernel's: a veth pair, and the shaper at the robot's end. In both, UDP datagrams are lost at the operator's end.
"""
import subprocess
import time
from typing import Any, Dict, List, NamedTuple, Optional, Sequence

from smokebot_udp.link_lab.lab import DEVICE, Lab, LabError, TwoSides, side_commands
from smokebot_udp.link_lab.link_trace import SIDES
from smokebot_udp.link_lab.second_link import SECOND_DEVICE, end_commands

from .shapers import LAB_DELAY, Count, Shaper, commands, counted, loss_rules

HOLDER = """
for key in ipv6/conf/all/disable_ipv6 ipv6/conf/default/disable_ipv6 ipv4/tcp_no_metrics_save; do
    echo 1 >/proc/sys/net/$key
done 2>/dev/null
echo ready
exec cat
"""
"""Holds a namespace until its standard input ends."""

WHOLE = 'tx-udp-segmentation', 'tso', 'gso', 'gro'
"""Features of a veth device by which it takes or makes super-packets: a loss would hit all datagrams of one."""


class VethPair(TwoSides):
    """Two namespaces joined by a veth pair that is not limited.

    :raises LabError: where they cannot be made
    """

    def __init__(self) -> None:
        self._holders: Dict[str, subprocess.Popen[Any]] = {}
        try:
            for side in SIDES:
                self._holders[side] = holder = subprocess.Popen(
                    ['unshare', '--net', 'sh', '-c', HOLDER], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                    universal_newlines=True)
                assert holder.stdout is not None
                if not holder.stdout.readline():
                    raise LabError('only root can make network namespaces: run it with sudo')
            super().__init__({side: '/proc/%d/ns/net' % holder.pid for side, holder in self._holders.items()})
            self._join(DEVICE, [side_commands(side, 'cubic') for side in SIDES])
        except BaseException:
            self.close()
            raise

    def join_again(self) -> None:
        """Join them by a second pair, with addresses of its own.

        :raises LabError: where that fails
        """
        self._join(SECOND_DEVICE, [end_commands(side) for side in SIDES])

    def _join(self, device: str, commands_of_sides: Sequence[Sequence[str]]) -> None:
        # between both namespaces at once: a device that moves loses its shaper
        self.must('robot', 'ip link add %s type veth peer name %s netns %d' % (
            device, device, self._holders['operator'].pid))
        for side, lines in zip(SIDES, commands_of_sides):
            for line in lines:
                self.must(side, 'ip ' + line)
            self.must(side, ' '.join(['ethtool -K', device, *(feature + ' off' for feature in WHOLE)]))

    def must(self, side: str, line: str) -> None:
        """Run a command on a side.

        :raises LabError: where it fails
        """
        try:
            done = self.run(side, line.split(), stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        except FileNotFoundError as error:
            raise LabError(str(error)) from None
        if done.returncode:
            raise LabError('%s: %s' % (line, done.stderr.decode().strip()))

    def close(self) -> None:
        """Remove the link: the namespaces vanish with their last process."""
        for holder in self._holders.values():
            assert holder.stdin is not None and holder.stdout is not None
            holder.stdin.close()
            holder.wait()
            holder.stdout.close()


class Sample(NamedTuple):
    """The counters at a time."""
    time: float
    """By time.time() [s]."""
    counted: Count


class ShapedLink:
    """A shaped link; `sides` is for a Stack, which removes it. It counts what the robot's side sends.

    :param rate: [bit/s]
    :param loss: of UDP datagrams to the operator, 0..1
    :param sides: joined by this device already, where the kernel shapes; None: they are made
    :raises LabError: where it cannot be made
    """

    def __init__(self, shaper: Shaper, rate: float, loss: float, seed: int = 1, sides: Optional[VethPair] = None,
                 device: str = DEVICE) -> None:
        self._shaper, self._device = shaper, device
        self.sides: TwoSides = sides or (VethPair() if shaper.in_kernel else Lab(seed))
        try:
            self._limit(rate, 'add')
            self.set_loss(loss)
        except BaseException:
            self.sides.close()
            raise

    def set_rate(self, rate: float) -> None:
        """Change the rate [bit/s]."""
        self._limit(rate, 'change')

    def _limit(self, rate: float, verb: str) -> None:
        if isinstance(self.sides, Lab):
            self.sides.set({'rate': rate, 'delay': LAB_DELAY, 'queue': self._shaper.queue,
                            'aggregate': self._shaper.aggregate})
        else:
            for command in commands(self._shaper, rate, verb, self._device):
                self._checked('robot', command)

    def set_loss(self, loss: float) -> None:
        """Change the loss of UDP datagrams to the operator, 0..1."""
        self._checked('operator', ['nft', '-f', '-'], input=loss_rules(loss, self._device).encode())

    def sample(self) -> Sample:
        """The counters now."""
        if isinstance(self.sides, Lab):
            counts = self.sides.counts()['robot']
            return Sample(time.time(), Count(counts['carried'], counts['dropped']))
        answer = self._checked('robot', ['tc', '-s', '-j', 'qdisc', 'show', 'dev', self._device])
        return Sample(time.time(), counted(answer))

    def _checked(self, side: str, command: List[str], **options: Any) -> str:
        done = self.sides.run(side, command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **options)
        if done.returncode:
            raise LabError('%s: %s' % (' '.join(command), done.stderr.decode().strip()))
        return str(done.stdout.decode())
