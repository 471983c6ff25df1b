# SPDX-License-Identifier: BSD-3-Clause
"""States that several sources report again and again: only the newest of each is worth sending, and they take turns."""
import math
from typing import Any, Callable, Optional

from .contents import Contents


class Turns(Contents):
    """What waits for one peer: the message of which something has waited longest goes next.

    :param message_class: of the messages
    """

    def __init__(self, message_class: Any) -> None:
        super().__init__(message_class)
        self._next = -math.inf      # when the next one may be sent [s]

    def due(self, packed: Callable[[Any], bytes], rate: float, now: float) -> Optional[bytes]:
        """The message to send now; None: nothing waits, or it is too soon after the last one.

        :param packed: f(message), what is sent of it
        :param rate: what all may take, on average [byte/s]
        :param now: by a steady clock [s]
        """
        message = self.take() if now >= self._next else None
        if message is None:
            return None
        data = packed(message)
        self._next = now + len(data) / rate
        return data
