# SPDX-License-Identifier: BSD-3-Clause
"""One link or two between the same two sides, by the link lab or by a kernel's shaper."""
from typing import List, Mapping, Sequence

from smokebot_udp.link_lab.lab import DEVICE, Lab
from smokebot_udp.link_lab.second_link import SECOND_DEVICE, second_lab

from .shaped_link import ShapedLink, VethPair
from .shapers import Shaper
from .started import Started

Conditions = Mapping[str, float]
"""Conditions of a link, as link_lab has them. A kernel's shaper takes `rate` and `loss`, and has a queue of its own."""


class LabLinks(Started):
    """By the link lab; a context manager.

    :param seed: of the first one; that of the second is the next number
    :raises LabError: as Lab
    """

    def __init__(self, conditions: Sequence[Conditions], seed: int) -> None:
        super().__init__()
        self.count = len(conditions)
        with self.starting():
            self.sides = self.enter_context(Lab(seed))
            self.labs = [self.sides]
            if self.count > 1:
                self.labs.append(self.enter_context(second_lab(self.sides, seed + 1)))
            for lab, one in zip(self.labs, conditions):
                lab.set(one)

    def carried(self) -> List[int]:
        """What each link has carried to the operator [byte]."""
        return [lab.counts()['robot']['carried'] for lab in self.labs]


class ShapedLinks(Started):
    """By a kernel's shaper; a context manager.

    :raises LabError: as ShapedLink
    """

    def __init__(self, conditions: Sequence[Conditions], shaper: Shaper) -> None:
        super().__init__()
        self.count = len(conditions)
        with self.starting():
            self.sides = self.enter_context(VethPair())
            if self.count > 1:
                self.sides.join_again()
            self._links = [ShapedLink(shaper, one['rate'], one.get('loss', 0.0), sides=self.sides, device=device)
                           for one, device in zip(conditions, (DEVICE, SECOND_DEVICE))]

    def carried(self) -> List[int]:
        """What each link has carried to the operator [byte]."""
        return [link.sample().counted.sent for link in self._links]
