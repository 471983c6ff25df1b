# SPDX-License-Identifier: BSD-3-Clause
"""What anybody may ask on a link without a key."""
from smokebot_udp.teleop.control_server import ControlServer
from smokebot_udp.teleop.records import Request, Wish

ROBOT, REASON = 7, 'the link has no key'


def test_anybody_may_stop_the_robot_but_not_release_the_stop_nor_take_control() -> None:
    server = ControlServer(ROBOT)
    server.closed = REASON
    for number, wish in enumerate((Wish.TAKE_CONTROL, Wish.ENGAGE_ESTOP, Wish.RELEASE_ESTOP), 1):
        now = 10.0 + number
        server.receive('anybody', number, Request(1, now, ROBOT, number, wish, now), now)
        status = server.poll(now)
        assert status is not None
        own, = status.operators
        assert (own.answered, own.refusal) == (number, '' if wish == Wish.ENGAGE_ESTOP else REASON)
    assert server.estop.engaged
    server.set_estop(False, 'somebody at the robot', 20.0)
    assert not server.estop.engaged
