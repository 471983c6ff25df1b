# SPDX-License-Identifier: BSD-3-Clause
"""Calls of services from the server's loop, each in a thread of its own."""
import asyncio
import contextlib
import threading
from typing import Any, Callable, Set, Tuple

import rospy

from ..nodes.teleop_keyboard import said


async def in_thread(work: Callable[[], Any]) -> Any:
    """What a function returns that may take long; a thread of its own does not keep the node from ending."""
    loop = asyncio.get_event_loop()
    future: asyncio.Future[Any] = loop.create_future()

    def finish(result: Any, error: Any) -> None:
        if not future.done():
            if error is None:
                future.set_result(result)
            else:
                future.set_exception(error)

    def run() -> None:
        result = error = None
        try:
            result = work()
        except Exception as exception:
            error = exception
        with contextlib.suppress(RuntimeError):    # the node ends
            loop.call_soon_threadsafe(finish, result, error)

    threading.Thread(target=run, name='call', daemon=True).start()
    return await future


class Calls:
    """Calls each service once at a time: another call would count as meant later. Used by the loop alone."""

    def __init__(self) -> None:
        self._running: Set[str] = set()

    async def call(self, service: str, class_: Any, *arguments: Any) -> Tuple[bool, str]:
        """Call a service that answers success and message: (whether it did it, in words)."""
        name = service.rpartition('/')[2]
        if service in self._running:
            return False, '%s: the last one is not answered yet' % name
        self._running.add(service)
        work = asyncio.ensure_future(in_thread(lambda: rospy.ServiceProxy(service, class_)(*arguments)))
        work.add_done_callback(lambda _: self._running.discard(service))
        try:
            answer = await asyncio.shield(work)     # who asked may go: the call goes on
        except (rospy.ServiceException, rospy.ROSException) as error:
            return False, '%s: %s' % (name, error)
        return bool(answer.success), said(name, answer)
