# SPDX-License-Identifier: BSD-3-Clause
"""Relay streams: small messages of any type as they are: odometry, battery, gas, tf.

Transforms are merged: the newest of each pair of frames is sent, those of many publishers in one message, as many as
fit a datagram. Latched messages are repeated, for lost datagrams and late subscribers.
"""
from typing import Any, List, Mapping, Optional, Sequence

from ...mission.parameters import Parameter
from ...mission.settings import Settings
from ...udpros.datagram import OVERHEAD
from ..encoder import Encoder, Payload
from ..parameters import ROBOT
from .transforms import QUEUE, RELAY, TF_TYPES, TransformSet, message_class


class RelayEncoder(Encoder[Any]):
    """Sends small messages, the newest at most `rate` times a second.

    What waits is a message, or a TransformSet.

    :raises ValueError: where the message type is unknown
    """
    PROTECTED, STAMPED, QUEUE_SIZE = True, False, QUEUE
    LEAST = {'rate': 1.0, 'repeat_rate': 0.2}
    PARAMETERS = {
        **ROBOT, **RELAY,
        'repeat_rate': Parameter(1.0, 'Hz', 'with latch: rate at which the last message is repeated', above=0.0,
                                 most=100.0, live=True),
    }

    def __init__(self, settings: Mapping[str, Any]) -> None:
        super().__init__(settings)
        self.MESSAGE = self.SEGMENT = message_class(settings['message_type'])
        self.KEEPS, self.STEADY = settings['latch'], not settings['latch']
        self._merges = settings['message_type'] in TF_TYPES
        self._kept: Any = TransformSet() if self._merges else None      # with latch: what is repeated

    def merge(self, waiting: Optional[Any], message: Any) -> Any:
        return self._with(TransformSet() if waiting is None else waiting, message) if self._merges else message

    def encode(self, message: Any, settings: Settings, max_datagram_size: int) -> List[Payload]:
        if self.KEEPS:
            message = self._kept = self._with(self._kept, message) if self._merges else message
        return self._messages(message, max_datagram_size)

    def repeat_period(self, settings: Settings) -> Optional[float]:
        return max(1.0 / settings['repeat_rate'], 1.0 / settings['rate']) if self.KEEPS else None

    def repeat(self, settings: Settings, max_datagram_size: int) -> Sequence[Payload]:
        return self._messages(self._kept, max_datagram_size) if self.KEEPS and self._kept is not None else ()

    def _with(self, transforms: TransformSet, message: Any) -> TransformSet:
        """A set with the transforms of a message, or of another set, added."""
        try:
            transforms.add(message)
        except ValueError as error:
            self.warnings.append(str(error))
        return transforms

    def _messages(self, content: Any, max_datagram_size: int) -> List[Payload]:
        return content.messages(self.MESSAGE, max_datagram_size - OVERHEAD) if self._merges else [content]
