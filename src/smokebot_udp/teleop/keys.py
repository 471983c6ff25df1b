# SPDX-License-Identifier: BSD-3-Clause
"""The keys of what a terminal sends.

A function key is an escape character and more characters, some of which have a meaning by themselves. Their grammar is
that of control functions in ECMA-48 (5.3.1, 5.3.2, 5.4), and of single shifts as xterm's keys use them:

======================  ===================================================================
 ESC [ P* I* F          control sequence: P of 0..?, I of space../, F of @..~
 ESC O P* F             single shift 3
 ESC I* F               another escape sequence: F of 0..~
======================  ===================================================================
"""
import math
import re
from typing import List

SEQUENCE = re.compile('\x1b(?:\\[[0-?]*[ -/]*[@-~]|O[0-?]*[@-~]|[ -/]*[0-NP-Z\\\\-~])')
BEGINNING = re.compile('\x1b(?:\\[[0-?]*[ -/]*|O[0-?]*|[ -/]*)\\Z')

TIMEOUT = 0.1
"""A sequence may come in pieces; what comes later than this after its escape character is another key [s]."""


class Keys:
    """Splits what is read into keys, also where it is read in pieces."""

    def __init__(self) -> None:
        self._begun = ''        # a sequence
        self._until = -math.inf

    def take(self, typed: str, now: float) -> List[str]:
        """The keys, each a character or a sequence.

        A sequence that has only begun is a key already, as the key Escape itself is, and once more when it is whole.

        :param now: by a steady clock [s]
        """
        text = (self._begun if now < self._until else '') + typed
        keys = []
        while text:
            sequence = SEQUENCE.match(text) or BEGINNING.match(text)
            keys.append(sequence.group() if sequence else text[0])
            text = text[len(keys[-1]):]
        self._begun = keys[-1] if keys and BEGINNING.match(keys[-1]) else ''
        self._until = now + TIMEOUT
        return keys
