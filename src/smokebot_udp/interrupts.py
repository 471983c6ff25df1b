# SPDX-License-Identifier: BSD-3-Clause
"""What Ctrl-C does while a program starts."""
import contextlib
import signal
from typing import Iterator


@contextlib.contextmanager
def ends_silently() -> Iterator[None]:
    """SIGINT ends the process at once, without a traceback: for the imports at its start, which take a second."""
    former = signal.signal(signal.SIGINT, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGINT, former)
