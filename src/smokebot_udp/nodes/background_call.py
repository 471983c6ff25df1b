# SPDX-License-Identifier: BSD-3-Clause
"""Calls that may take seconds, such as of a master that does not answer, for threads that must not wait."""
import concurrent.futures
import threading
from typing import Callable, Generic, Optional, TypeVar

Answer = TypeVar('Answer')


class BackgroundCall(Generic[Answer]):
    """Calls a function in a thread of its own, one call at a time.

    :param function: f() -> answer
    """

    def __init__(self, function: Callable[[], Answer]) -> None:
        self._function = function
        self._pending: Optional[concurrent.futures.Future[Answer]] = None

    def __call__(self) -> Optional[Answer]:
        """The answer of the call that was begun last, once; None: it has not come yet, or a call begins now.

        :raises: what the function has raised
        """
        pending = self._pending
        if pending is None:
            self._pending = pending = concurrent.futures.Future()
            threading.Thread(target=self._call, args=(pending,), daemon=True).start()
        if not pending.done():
            return None
        self._pending = None
        return pending.result()

    def _call(self, pending: 'concurrent.futures.Future[Answer]') -> None:
        try:
            pending.set_result(self._function())
        except BaseException as error:
            pending.set_exception(error)
