# SPDX-License-Identifier: BSD-3-Clause
"""Who may see the page, and who may drive: tokens, and the sessions that they begin.

Requests come from the page itself: others' pages must not use a browser's cookie, nor a name of their own that leads to
this machine.
"""
import enum
import hmac
import ipaddress
from typing import NamedTuple, Optional
from urllib.parse import urlsplit

from ..budget import Budget
from ..newest import Newest

SESSION_LIFE = 12 * 3600.0
"""[s]"""

MAX_SESSIONS, MAX_ADDRESSES = 256, 256
"""That are remembered; of more the oldest are forgotten."""

TRIES, TRY_PERIOD = 5, 3.0
"""Logins of one address at once, and interval of further ones [s]."""

ALL_TRIES, ALL_TRY_PERIOD = 60, 0.2
"""Likewise of all addresses."""


class Role(enum.IntEnum):
    """What a browser may do; each may do what those before it may."""
    NONE = 0
    VIEWER = 1
    DRIVER = 2

    @property
    def text(self) -> str:
        return self.name.lower()


class Refused(Exception):
    """A login is refused, in words.

    :param too_many: whether it was not even looked at
    """

    def __init__(self, text: str, too_many: bool = False) -> None:
        super().__init__(text)
        self.too_many = too_many


class _Session(NamedTuple):
    role: Role
    until: float
    """[s]"""


class Access:
    """Decides; times are by a steady clock [s].

    :param page: token of the page; None: there is none, and browsers on this machine are viewers
    :param driver: token of the driver; None: nobody may drive
    """

    def __init__(self, page: Optional[bytes], driver: Optional[bytes]) -> None:
        self.page, self.driver = page, driver
        self._sessions: Newest[str, _Session] = Newest(MAX_SESSIONS)
        self._tries: Newest[str, Budget] = Newest(MAX_ADDRESSES)
        self._all_tries = Budget(ALL_TRIES, ALL_TRY_PERIOD)

    def login(self, token: str, session: str, address: str, now: float, new_session: str) -> str:
        """Begin a session, or add to one.

        :param token: hexadecimal digits
        :param session: of the browser; empty: it has none
        :param new_session: a random text that nobody can guess
        :return: the session
        :raises Refused: a wrong token, or too many logins
        """
        if not (self._tries.of(address, lambda: Budget(TRIES, TRY_PERIOD)).take(now) and self._all_tries.take(now)):
            raise Refused('too many logins: try again in some seconds', too_many=True)
        role = self._role_of(token)
        if role is Role.NONE:
            raise Refused('this token is wrong')
        del self._tries[address]    # who has a token may log in as often as it likes
        known = self._known(session, now)
        session = new_session if known is Role.NONE else session
        self._sessions[session] = _Session(max(role, known), now + SESSION_LIFE)
        return session

    def logout(self, session: str) -> None:
        """Forget a session."""
        self._sessions.pop(session, None)

    def role(self, session: str, local: bool, now: float) -> Role:
        """What a browser may do.

        :param session: of its cookie; empty: none
        :param local: whether it runs on this machine
        """
        return max(self._known(session, now), Role.VIEWER if local and self.page is None else Role.NONE)

    def _known(self, session: str, now: float) -> Role:
        found = self._sessions.get(session)
        return found.role if found is not None and now < found.until else Role.NONE

    def _role_of(self, token: str) -> Role:
        try:
            data = bytes.fromhex(token.strip())
        except ValueError:
            return Role.NONE
        if self.driver is not None and hmac.compare_digest(data, self.driver):
            return Role.DRIVER
        if self.page is not None and hmac.compare_digest(data, self.page):
            return Role.VIEWER
        return Role.NONE


def is_own(origin: Optional[str], host: str, secure: bool) -> bool:
    """Whether a request is of this page, or of no page.

    :param origin: header Origin; None: there is none
    :param host: header Host
    :param secure: whether TLS is used
    """
    return origin is None or origin.lower() == '%s://%s' % ('https' if secure else 'http', host.lower())


def is_local(address: str, host: str) -> bool:
    """Whether a browser runs on this machine, and asks for it by a name that is not of somebody else's domain.

    :param address: of the browser
    :param host: header Host
    """
    try:
        name = urlsplit('//' + host).hostname or ''
        return ipaddress.ip_address(address).is_loopback and (
            name == 'localhost' or ipaddress.ip_address(name).is_loopback)
    except ValueError:
        return False
