# SPDX-License-Identifier: BSD-3-Clause
"""A second emulated link between the two sides of a lab: each side has two devices and two addresses then."""
import subprocess
from typing import List

from .lab import DEVICE, Lab, TwoSides
from .link_trace import SIDES

SECOND_DEVICE = 'air2'
SECOND = {'robot': '10.77.1.1', 'operator': '10.77.1.2'}
"""The addresses of the second link."""


def namespace_of(sides: TwoSides, side: str) -> str:
    """The path of a side's network namespace."""
    return sides.command(side, [])[-1].split('=')[1]


def ip(sides: TwoSides, side: str, line: str) -> None:
    """Run the command `ip` on a side."""
    sides.run(side, ['ip', *line.split()], check=True, stdout=subprocess.DEVNULL)


def end_commands(side: str) -> List[str]:
    """Arguments of `ip` that give a side's end of the second link its address, in the side's namespace."""
    other = next(name for name in SIDES if name != side)
    return ['link set %s up' % SECOND_DEVICE, 'addr add %s peer %s dev %s' % (
        SECOND[side], SECOND[other], SECOND_DEVICE)]


def join_end(second: TwoSides, side: str, into: TwoSides) -> None:
    """Move a side's end of a second link into another lab's namespace, and give it addresses of its own."""
    ip(second, side, 'link set %s netns %s name %s' % (DEVICE, namespace_of(into, side), SECOND_DEVICE))
    for line in end_commands(side):
        ip(into, side, line)


def second_lab(lab: TwoSides, seed: int) -> Lab:
    """Another link between the sides of a lab.

    :param seed: of its random effects
    :raises LabError: as Lab
    """
    second = Lab(seed)
    try:
        for side in SIDES:
            join_end(second, side, lab)
    except BaseException:
        second.close()
        raise
    return second
