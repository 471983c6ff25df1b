# SPDX-License-Identifier: BSD-3-Clause
"""Text for messages that must be long on the air, too."""
import random
import string


def noise(length: int, seed: int = 0) -> str:
    """Text that zlib shortens by a quarter only."""
    return ''.join(random.Random(seed).choices(string.ascii_letters + string.digits, k=length))
