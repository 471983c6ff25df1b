# SPDX-License-Identifier: BSD-3-Clause
"""What operators and the robot tell each other about who drives and about the emergency stop.

The records mirror the messages ControlRequest, ControlStatus and ControlPeer, with times in seconds. `of` reads what
came from the network and checks it; `fields` returns a message's keyword arguments.
"""
import enum
import math
from typing import Any, Dict, NamedTuple, Optional, Tuple

from .command_copy import MICROSECONDS

MAX_OPERATORS = 8
"""Operators that are present at a time."""

MAX_OTHERS = 4
"""Others to whom a status answers."""

MAX_TEXT = 200
"""Length of a name or reason; longer ones are cut [characters]."""


class Wish(enum.IntEnum):
    """What an operator asks of the robot; the numbers are those of ControlRequest."""
    NOTHING = 0
    TAKE_CONTROL = 1
    RELEASE_CONTROL = 2
    ENGAGE_ESTOP = 3
    RELEASE_ESTOP = 4


class Request(NamedTuple):
    """An operator's presence, and what it asks of the robot."""
    session: int
    """Session of the operator's node: a random number other than 0."""
    clock: float
    """When this was sent, by the operator's steady clock [s]."""
    robot: int = 0
    """Session of the robot's node that is asked; 0: any."""
    id: int = 0
    """Id of what is requested. It grows with each request; 0: nothing is requested."""
    wish: Wish = Wish.NOTHING
    made: float = 0.0
    """When it was asked, by the robot's steady clock [s]; 0: unknown."""

    @classmethod
    def of(cls, message: Any) -> 'Request':
        """Read a ControlRequest.

        :raises ValueError: where it makes no sense
        """
        if not message.session:
            raise ValueError('a request without a session')
        try:
            wish = Wish(message.wish)
        except ValueError:
            raise ValueError('a request with wish %d' % message.wish) from None
        if bool(message.request) != bool(wish):
            raise ValueError('a request with id %d and wish %d' % (message.request, wish))
        return cls(message.session, _seconds(message.clock), message.robot, message.request, wish,
                   _seconds(message.made))

    def fields(self) -> Dict[str, Any]:
        """The fields of a ControlRequest, without its header."""
        return {'session': self.session, 'clock': microseconds(self.clock), 'robot': self.robot, 'request': self.id,
                'wish': int(self.wish), 'made': microseconds(self.made)}


class PeerStatus(NamedTuple):
    """What the robot knows of one operator."""
    session: int
    name: str
    echo: float
    """`clock` of its newest request [s]."""
    held: float
    """The time since then until the status was sent [s]."""
    answered: int = 0
    """Id of its last request that was answered."""
    refusal: str = ''
    """Why that was refused; empty: it was not."""
    loss: Optional[float] = None
    """Ratio of its datagrams that did not arrive, 0..1; None: unknown."""

    @classmethod
    def of(cls, message: Any) -> 'PeerStatus':
        """Read a ControlPeer."""
        loss = message.loss if math.isfinite(message.loss) and 0 <= message.loss <= 1 else None
        return cls(message.session, _text(message.name), _seconds(message.echo), _seconds(message.held),
                   message.answered, _text(message.refusal), loss)

    def fields(self) -> Dict[str, Any]:
        """The fields of a ControlPeer."""
        return {'session': self.session, 'name': self.name, 'echo': microseconds(self.echo),
                'held': min(microseconds(self.held), 0xffffffff), 'answered': self.answered, 'refusal': self.refusal,
                'loss': -1.0 if self.loss is None else self.loss}


class Status(NamedTuple):
    """Who drives, and whether the emergency stop is engaged."""
    session: int
    """Session of the robot's node: a random number other than 0."""
    clock: float
    """When this was sent, by the robot's steady clock [s]."""
    driver: str = ''
    """Name of the operator who drives; empty: nobody."""
    driver_session: int = 0
    estop: bool = False
    estop_by: str = ''
    """Who engaged it last."""
    releases: int = 0
    """How often it was released."""
    operators: Tuple[PeerStatus, ...] = ()
    """Those that are present."""
    others: Tuple[PeerStatus, ...] = ()
    """Those that are not, and have asked for something: too many, for example."""

    @classmethod
    def of(cls, message: Any) -> 'Status':
        """Read a ControlStatus.

        :raises ValueError: where it makes no sense
        """
        if not message.session:
            raise ValueError('a status without a session')
        if len(message.operators) > MAX_OPERATORS or len(message.others) > MAX_OTHERS:
            raise ValueError('a status of %d operators and %d others' % (len(message.operators), len(message.others)))
        return cls(message.session, _seconds(message.clock), _text(message.driver), message.driver_session,
                   bool(message.estop), _text(message.estop_by), message.releases,
                   tuple(map(PeerStatus.of, message.operators)), tuple(map(PeerStatus.of, message.others)))

    def fields(self) -> Dict[str, Any]:
        """The fields of a ControlStatus, without its header; `operators` and `others` are PeerStatus."""
        return {**self._asdict(), 'clock': microseconds(self.clock)}


def microseconds(seconds: float) -> int:
    """A time as the messages have it; one that no message can have is 0 [us]."""
    return round(seconds * MICROSECONDS) if 0 < seconds < 2 ** 64 / MICROSECONDS else 0


def _seconds(time: int) -> float:
    return time / MICROSECONDS


def _text(text: str) -> str:
    return text[:MAX_TEXT]
