# SPDX-License-Identifier: BSD-3-Clause
"""The robot's side of all transfers: which original is to be coded, and which pieces leave next. Times are by a steady
clock [s]."""
import math
from typing import Dict, List, NamedTuple, Optional, Tuple, Union

from ..newest import Newest
from .sending import Piece, Sending

MAX_TRANSFERS = 4
"""Maximum number of operators that fetch at a time. Further ones wait, and repeat their requests."""

TIMEOUT = 30.0
"""A transfer whose operator was silent for this long is forgotten [s]."""

MAX_ENDED = 64
"""Maximum number of operators whose last capture is remembered: its requests may be late."""

MAX_RATE = 2e6
"""Maximum rate of pieces, for links without a limit and receivers whose buffer is unknown [byte/s]."""


class Request(NamedTuple):
    """What an operator asks for: the fields of CaptureRequest that say it."""
    id: int
    stream: str
    stamp: int
    """Time stamp of the original; 0: the newest one [ns]."""
    region: Tuple[int, int, int, int]
    """Region of an image: x, y, width, height; width and height 0: all of it [pixel]."""
    layered: bool


class Load(NamedTuple):
    """An original is to be found and coded."""
    operator: str
    request: Request


class Batch(NamedTuple):
    """Pieces are to be sent."""
    operator: str
    id: int
    pieces: List[Piece]


class _Transfer:
    """One operator's."""

    def __init__(self, request: Request, now: float) -> None:
        self.request, self.heard = request, now
        self.loading = False
        self.sending: Optional[Sending] = None      # None until the original is coded


class Transfers:
    """The transfers of a robot, one for each operator. They take turns.

    """

    def __init__(self) -> None:
        self.batch = 1
        """Pieces that may leave together."""
        self.refused = 0
        """Impossible reports."""
        self._transfers: Dict[str, _Transfer] = {}      # the next one's turn comes first
        self._ended: Newest[str, int] = Newest(MAX_ENDED)   # {operator: the last capture that ended}
        self._due = -math.inf       # nothing leaves before

    @property
    def left(self) -> int:
        """What the operators do not hold yet of what is coded [byte]."""
        return sum(one.sending.left for one in self._transfers.values() if one.sending is not None)

    def request(self, operator: str, request: Request, received: bytes, order: int, now: float) -> None:
        """Take a CaptureRequest; another one than before replaces the operator's transfer."""
        self._expire(now)
        known = self._transfers.get(operator)
        if self._ended.get(operator) == request.id:
            return      # it was late on its way
        if known is None or known.request.id != request.id:
            if known is None and len(self._transfers) >= MAX_TRANSFERS:
                return
            self._transfers[operator] = _Transfer(request, now)
            return
        known.heard = now
        if known.sending is not None:
            try:
                known.sending.acknowledge(received, order, now)
            except ValueError:      # of another sender's pieces, such as this node's before its restart
                self.refused += 1
                known.sending.acknowledge(b'', 0, now)

    def end(self, operator: str, id_: int) -> None:
        """The operator needs nothing more of a capture."""
        known = self._transfers.get(operator)
        if known is not None and known.request.id == id_:
            del self._transfers[operator]
            self._ended[operator] = id_

    def loaded(self, load: Load, data: bytes, length: int, now: float) -> None:
        """An original is coded: it is sent in pieces of this length."""
        known = self._transfers.get(load.operator)
        if known is not None and known.request.id == load.request.id:
            known.sending = Sending(data, length, now)

    def poll(self, now: float) -> Optional[Union[Load, Batch]]:
        """What is to be done now; None: nothing."""
        for operator, transfer in self._transfers.items():
            if not transfer.loading:
                transfer.loading = True
                return Load(operator, transfer.request)
        if now < self._due:
            return None
        for operator, transfer in list(self._transfers.items()):
            if transfer.sending is None:
                continue
            taken = (transfer.sending.take(now) for _ in range(self.batch))
            pieces = [piece for piece in taken if piece is not None]
            if pieces:
                self._transfers[operator] = self._transfers.pop(operator)       # the others are next
                self._due = now + sum(len(piece.data) for piece in pieces) / MAX_RATE
                return Batch(operator, transfer.request.id, pieces)
        return None

    def deadline(self, now: float) -> float:
        """When `poll` has something next [s]; infinite: never."""
        if any(not transfer.loading for transfer in self._transfers.values()):
            return -math.inf
        dues = [one.sending.due(now) for one in self._transfers.values() if one.sending is not None]
        return max(self._due, min(dues, default=math.inf))

    def _expire(self, now: float) -> None:
        self._transfers = {operator: one for operator, one in self._transfers.items() if now - one.heard <= TIMEOUT}
