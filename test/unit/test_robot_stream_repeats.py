# SPDX-License-Identifier: BSD-3-Clause
"""The runner of the robot's streams: messages that are kept, repeated, and sent until operators hold them."""
import time
from typing import Any, List, Mapping, Optional

from nav_msgs.msg import Odometry
from polling import give_time, wait_for
from robot_stream_case import Make, Recorder, logged, make, scan
from sensor_msgs.msg import LaserScan

from smokebot_udp.mission.settings import Settings
from smokebot_udp.streams.encoder import Encoded, LinkView, Traits
from smokebot_udp.streams.held import Holding

__all__ = ['logged', 'make']


class Keeper(Recorder):
    """As maps: kept for late subscribers, encoded again, repeated."""
    traits = Traits(stamped=False, keeps=True, reencodes=True)
    number: Optional[int] = None

    def encode(self, message: Any, settings: Settings, link: LinkView) -> Encoded:
        before, self.number = self.number, len(message.ranges)
        self.calls.append(self.number)
        return Encoded([] if self.number == before else [self.frame(self.number)])

    def repeat_period(self, settings: Settings, link: LinkView) -> Optional[float]:
        return 1.0 / float(settings['repeat_rate'])

    def repeat(self, settings: Settings, link: LinkView) -> Encoded:
        return Encoded([self.frame(100 + (self.number or 0))])


def test_what_came_before_its_listener_is_sent_to_it_at_once(make: Make) -> None:
    made = make(Keeper, repeat_rate=0.001)
    made.segments.listeners = 0
    made.stream.receive(scan(5))
    wait_for(lambda: made.stream.encoder.calls)
    give_time()
    assert made.segments.published == []
    made.segments.listeners = 1
    made.stream.peer_subscribe('segments', None, None)
    wait_for(lambda: made.segments.published == [105])


def test_an_unchanged_message_is_repeated_and_a_changed_one_goes_at_once(make: Make) -> None:
    made = make(Keeper, repeat_rate=50.0)
    made.stream.receive(scan(5))
    wait_for(lambda: made.segments.published[:3] == [5, 105, 105])
    made.stream.settings.request({'repeat_rate': 0.001})
    made.stream.receive(scan(6))
    wait_for(lambda: 6 in made.segments.published)
    give_time()
    assert made.segments.published[-1] == 6
    made.stream.settings.grant({'repeat_rate': 50.0})       # counts for the next repeat already
    wait_for(lambda: 106 in made.segments.published)


def test_other_settings_encode_the_last_message_again(make: Make) -> None:
    made = make(Keeper, repeat_rate=0.001)
    made.stream.receive(scan(5))
    wait_for(lambda: made.segments.published == [5])
    made.stream.settings.grant({'repeat_rate': 0.002})
    wait_for(lambda: made.stream.encoder.calls == [5, 5])
    made.stream.settings.grant({'repeat_rate': 0.002})      # no change
    give_time()
    assert made.stream.encoder.calls == [5, 5] and made.segments.published == [5]


def test_nothing_is_repeated_while_it_is_still_leaving(make: Make) -> None:
    made = make(Keeper, repeat_rate=100.0)
    made.link.outbox.change(lambda scheduler: scheduler.set_rate(1.0, time.monotonic()))      # 1 byte/s
    made.stream.receive(scan(5))        # a burst lets it go
    wait_for(lambda: made.segments.published == [5])
    wait_for(lambda: made.link.outbox.sending('scan'))
    give_time(0.1)
    assert made.link.outbox.dropped('scan') == 0        # one repeat waits, and no other replaced it


# messages that are sent little by little, until operators hold them

class Counting(Recorder):
    """Counts down to 0, one datagram each 10 ms, from what operators report; a further topic sets the count."""
    traits = Traits(stamped=False, keeps=True)

    def __init__(self, settings: Mapping[str, Any]) -> None:
        super().__init__(settings)
        self.left = 0

    def sources(self, settings: Mapping[str, Any]) -> Mapping[str, Any]:
        return {'/more': Odometry}

    def merge(self, waiting: Optional[Any], message: Any) -> Optional[Any]:
        if message._type == LaserScan._type:
            return message
        if message.header.seq > 5:
            raise ValueError('it is too much')
        return None

    def encode(self, message: Any, settings: Settings, link: LinkView) -> Encoded:
        self.left = len(message.ranges)
        return self.repeat(settings, link)

    def repeat_period(self, settings: Settings, link: LinkView) -> Optional[float]:
        return 0.01 if self.left else 1000.0

    def repeat(self, settings: Settings, link: LinkView) -> Encoded:
        self.left -= 1
        return Encoded([self.frame(self.left)])

    def held(self, operator: str, holding: Holding) -> None:
        self.calls.append(operator)
        self.left = holding.session


def test_repeats_follow_the_period_that_the_encoder_wants_now(make: Make) -> None:
    made = make(Counting)
    made.stream.receive(scan(3))
    wait_for(lambda: made.segments.published == [2, 1, 0])
    assert made.stream.held('/operator', Holding(2, ()))
    wait_for(lambda: made.segments.published == [2, 1, 0, 1, 0])
    assert not made.stream.held('/stranger', Holding(9, ())) and made.stream.encoder.calls == ['/operator']


def test_messages_of_further_topics_are_merged(make: Make, logged: List[str]) -> None:
    made = make(Counting)
    more = made.named('/more')
    assert more.message_class is Odometry and made.named('/in').message_class is LaserScan
    receive = more.args[0]
    message = Odometry()
    receive(message)
    message.header.seq = 6
    receive(message)
    receive(scan(1))
    assert made.segments.published == [] and logged == [
        "stream 'scan': a message of /more is not sent: it is too much",
        "stream 'scan': a message of /more is not sent: it is sensor_msgs/LaserScan, must be nav_msgs/Odometry"]
    made.stream.close()
    assert more.closed
