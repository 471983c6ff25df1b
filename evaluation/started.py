# SPDX-License-Identifier: BSD-3-Clause
"""What an experiment starts: it ends with it, also where something of it cannot be started."""
import contextlib
from typing import Iterator


class Started(contextlib.ExitStack):
    """A context manager from its construction on: `close` ends what was entered, in reverse order."""

    @contextlib.contextmanager
    def starting(self) -> Iterator[None]:
        """A context for the constructor: an exception in it ends what has been started already."""
        try:
            yield
        except BaseException:
            self.close()
            raise
