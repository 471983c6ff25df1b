# SPDX-License-Identifier: BSD-3-Clause
"""Whether a request comes from the page itself: others' pages must not use a browser's cookie, nor a name of their own
that leads to this machine."""
import ipaddress
from typing import Optional
from urllib.parse import urlsplit


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
