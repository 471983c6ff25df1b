# SPDX-License-Identifier: BSD-3-Clause
"""An encoder with the link that it sees: without a runner, for tests and measurements."""
from typing import Any, List, Optional

from smokebot_udp.mission.settings import Settings
from smokebot_udp.streams.encoder import Encoded, Encoder, LinkView
from smokebot_udp.udpros.datagram import DEFAULT_MAX_DATAGRAM_SIZE
from smokebot_udp.udpros.frame import Frame


class LinkedEncoder:
    """What is not said here is as of the encoder.

    :param link: fields of LinkView that differ from their defaults
    """

    def __init__(self, encoder: Encoder[Any], **link: Any) -> None:
        self.encoder, self.link = encoder, LinkView(**link)

    def see(self, **link: Any) -> None:
        """The link changes: fields of LinkView."""
        self.link = self.link._replace(**link)

    def encoded(self, message: Any, settings: Settings, datagram_size: int = DEFAULT_MAX_DATAGRAM_SIZE) -> Encoded:
        """As Encoder.encode."""
        return self.encoder.encode(message, settings, self.link._replace(datagram_size=datagram_size))

    def encode(self, message: Any, settings: Settings, datagram_size: int = DEFAULT_MAX_DATAGRAM_SIZE) -> List[Frame]:
        """The frames that carry a message."""
        return list(self.encoded(message, settings, datagram_size).frames)

    def repeat(self, settings: Settings, datagram_size: int = DEFAULT_MAX_DATAGRAM_SIZE) -> List[Frame]:
        """The frames of a repeat."""
        return list(self.encoder.repeat(settings, self.link._replace(datagram_size=datagram_size)).frames)

    def repeat_period(self, settings: Settings) -> Optional[float]:
        return self.encoder.repeat_period(settings, self.link)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.encoder, name)
