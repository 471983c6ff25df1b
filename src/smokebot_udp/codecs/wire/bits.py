# SPDX-License-Identifier: BSD-3-Clause
"""Numbers in bits, the highest of each byte first, as in NAL units of H.264 (ITU-T H.264, 7.2, 7.3.1 and 9.1).

They are read from the network, so each read is checked.
"""
import re

MAX_ZEROS = 31
"""Zeros in front of an Exp-Golomb code, at most: its value has 32 bits."""

_ESCAPE = re.compile(b'\0\0\x03')
_TO_ESCAPE = re.compile(b'\0\0(?=[\0-\x03])')


def unescaped(payload: bytes) -> bytes:
    """Without emulation prevention bytes."""
    return _ESCAPE.sub(b'\0\0', payload)


def escaped(payload: bytes) -> bytes:
    """With emulation prevention bytes: no start code is within."""
    text = _TO_ESCAPE.sub(b'\0\0\x03', payload)
    return text + b'\x03' if text.endswith(b'\0') else text


class BitReader:
    """Reads from the first bit on.

    :param payload: without emulation prevention bytes
    """

    def __init__(self, payload: bytes) -> None:
        self._value = int.from_bytes(payload, 'big')
        self._left = 8 * len(payload)

    def bits(self, count: int) -> int:
        """An unsigned number of `count` bits.

        :raises ValueError: the payload ends before
        """
        if count > self._left:
            raise ValueError('%d bits are wanted, %d are left' % (count, self._left))
        self._left -= count
        return self._value >> self._left & (1 << count) - 1

    def flag(self) -> bool:
        """One bit.

        :raises ValueError: as `bits`
        """
        return self.bits(1) == 1

    def unsigned(self, most: int) -> int:
        """An unsigned Exp-Golomb code, ue(v).

        :param most: the largest value that is valid
        :raises ValueError: it is larger, or the payload ends before
        """
        zeros = 0
        while not self.bits(1):
            zeros += 1
            if zeros > MAX_ZEROS:
                raise ValueError('an Exp-Golomb code begins with more than %d zeros' % MAX_ZEROS)
        value = (1 << zeros) - 1 + self.bits(zeros)
        if value > most:
            raise ValueError('a field of a NAL unit is %d, must be at most %d' % (value, most))
        return value

    def signed(self, most: int) -> int:
        """A signed Exp-Golomb code, se(v).

        :param most: the largest magnitude that is valid
        :raises ValueError: as `unsigned`
        """
        code = self.unsigned(2 * most)
        return (code + 1) // 2 if code & 1 else -(code // 2)


class BitWriter:
    """Writes from the first bit on."""

    def __init__(self) -> None:
        self._value = 0
        self._length = 0

    def bits(self, value: int, count: int) -> None:
        """An unsigned number of `count` bits."""
        self._value = self._value << count | value
        self._length += count

    def unsigned(self, value: int) -> None:
        """An unsigned Exp-Golomb code, ue(v)."""
        self.bits(value + 1, 2 * (value + 1).bit_length() - 1)

    def signed(self, value: int) -> None:
        """A signed Exp-Golomb code, se(v)."""
        self.unsigned(2 * value - 1 if value > 0 else -2 * value)

    def payload(self, filler: int) -> bytes:
        """What was written, up to a whole byte.

        :param filler: the bit that fills the last byte
        """
        free = -self._length % 8
        return (self._value << free | filler * ((1 << free) - 1)).to_bytes((self._length + free) // 8, 'big')
