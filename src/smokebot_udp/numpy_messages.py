# SPDX-License-Identifier: BSD-3-Clause
"""Messages whose arrays are numpy's, as those of rospy.numpy_msg, with any numpy: those are written by `tostring()`,
which numpy 2.3 has removed."""
import functools
from typing import Any

import numpy as np


class _Written(np.ndarray):
    """An array that genpy can write."""
    tostring = np.ndarray.tobytes


def _serialize(self: Any, buff: Any) -> None:
    """As genpy's."""
    values = (getattr(self, name) for name in self.__slots__)
    plain = self.PLAIN(*(value.view(_Written) if isinstance(value, np.ndarray) else value for value in values))
    plain.serialize_numpy(buff, np)


def _deserialize(self: Any, data: bytes) -> Any:
    """As genpy's; the arrays are parts of the data."""
    return self.deserialize_numpy(data, np)


@functools.lru_cache(maxsize=None)
def numpy_msg(message_class: Any) -> Any:
    """The class of such messages, the same one whenever it is asked for."""
    return type('Numpy' + message_class.__name__, (message_class,), {
        '__slots__': message_class.__slots__, 'PLAIN': message_class, 'serialize': _serialize,
        'deserialize': _deserialize})
