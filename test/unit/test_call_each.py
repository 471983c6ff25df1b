# SPDX-License-Identifier: BSD-3-Clause
from typing import List

from smokebot_udp.nodes.robot_control import call_each


def test_a_listener_that_fails_does_not_keep_the_stop_from_the_others() -> None:
    called: List[str] = []
    errors: List[Exception] = []
    error = ValueError('closed')

    def fail() -> None:
        raise error
    call_each([lambda: called.append('first'), fail, lambda: called.append('last')], errors.append)
    assert called == ['first', 'last'] and errors == [error]
