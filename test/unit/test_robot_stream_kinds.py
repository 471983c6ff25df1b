# SPDX-License-Identifier: BSD-3-Clause
"""The runner of the robot's streams: of several parts, of messages made on the robot, and protected ones."""
import time
from typing import Any, List, Sequence

from genpy import Time
from polling import give_time, wait_for
from robot_stream_case import Make, Recorder, logged, make, scan
from sensor_msgs.msg import LaserScan, PointCloud2

from smokebot_udp.mission.parameters import Parameter
from smokebot_udp.mission.settings import Settings
from smokebot_udp.msg import GridSegment, ScanSegment
from smokebot_udp.nodes.derived_stream import DerivedStream
from smokebot_udp.nodes.relay_stream import RelayStream
from smokebot_udp.streams.encoder import Encoded, LinkView, Traits
from smokebot_udp.streams.parameters import ROBOT
from smokebot_udp.udpros.frame import Frame

__all__ = ['logged', 'make']


class TwoParts(Recorder):
    """Sends scans of more than 10 ranges on another part, where that may be and all receive it."""
    SEGMENTS = {'segments': ScanSegment, 'layers': GridSegment}
    PARAMETERS = {**ROBOT, 'coding': Parameter('interleaved', '', '', live=True)}

    def parts(self, settings: Settings) -> Sequence[str]:
        return ['segments'] if settings['coding'] == 'interleaved' else ['segments', 'layers']

    def encode(self, message: Any, settings: Settings, link: LinkView) -> Encoded:
        number = len(message.ranges)
        self.message_size = 1000
        if number <= 10 or not link.heard('layers'):
            return Encoded([self.frame(number)])
        frame = Frame(GridSegment, 1, {})
        frame.records['index'] = number
        return Encoded([frame])


class Maker(Recorder):
    MESSAGE, DERIVED = PointCloud2, LaserScan
    PARAMETERS = {**ROBOT, 'scan_topic': Parameter('', '', '')}

    def derive(self, message: Any, settings: Settings) -> Any:
        return LaserScan(ranges=[0.0] * message.width)


class Protected(Recorder):
    """Sends scans at once until one has 100 ranges."""
    traits = Traits(stamped=False, queue_size=100)
    protected, replaced = True, 0

    def encode(self, message: Any, settings: Settings, link: LinkView) -> Encoded:
        self.calls.append(link.datagram_size)
        self.warnings.append('half of it is missing')
        self.protected = self.protected and len(message.ranges) < 100
        self.message_size = 1000
        return Encoded([self.frame(len(message.ranges))] * 2)


LAYERS = '/smokebot_udp/scan/layers'


def test_a_part_is_advertised_when_it_is_first_needed_and_stays(make: Make) -> None:
    made = make(TwoParts)
    made.stream.receive(scan(11))
    wait_for(lambda: made.segments.published == [11])
    assert made.named(LAYERS) is None
    made.stream.settings.request({'coding': 'auto'})
    made.stream.receive(scan(12))
    wait_for(lambda: made.named(LAYERS) and made.named(LAYERS).published == [12])
    layers = made.named(LAYERS)
    assert layers.message_class is GridSegment and layers.options['subscriber_listener'] is made.stream
    made.stream.settings.request({'coding': 'interleaved'})
    for number in (3, 13):
        made.stream.receive(scan(number))
        wait_for(lambda number=number: number in made.segments.published + layers.published)
    assert layers.published == [12, 13] and len([one for one in made.topics if one.name == LAYERS]) == 1
    wait_for(lambda: made.stream.stats().messages_out == 4)     # the outbox, another thread, may be faster
    assert [one.name for one in made.stream.stats().connections] == ['scan', 'scan/layers']
    made.stream.close()
    assert layers.closed and made.segments.closed


def test_a_part_counts_as_heard_only_where_every_operator_receives_it(make: Make) -> None:
    made = make(TwoParts, coding='auto')
    layers = made.named(LAYERS)
    layers.listeners = 0            # the operator is about to subscribe
    made.stream.receive(scan(11))
    wait_for(lambda: made.segments.published == [11])
    layers.listeners, layers.peer = 1, '/desk2'
    made.stream.receive(scan(12))
    wait_for(lambda: made.segments.published == [11, 12])
    assert made.stream.subscribers == {'/operator', '/desk2'}
    layers.peer = '/operator'
    made.stream.receive(scan(13))
    wait_for(lambda: layers.published == [13])
    made.segments.listeners = 0     # somebody wants nothing but layers
    made.stream.receive(scan(14))
    wait_for(lambda: layers.published == [13, 14])
    assert made.stream.heard and made.stream.demand(0.0) is not None
    layers.listeners = 0
    assert not made.stream.heard and not made.stream.subscribers


def cloud(number: int) -> Any:
    message = PointCloud2(width=number)
    message.header.stamp = Time(number, 0)
    return message


def test_derived_messages_are_published_at_the_requested_rate_and_sent_at_the_granted_one(make: Make) -> None:
    made = make(Maker, DerivedStream)
    assert (made.local.name, made.local.message_class) == ('scan', LaserScan)
    made.stream.settings.grant({'rate': 0.001})
    for number in range(1, 6):
        made.stream.settings.grant({'rate': 0.001 + 1e-9 * number})
        made.stream.receive(cloud(number))
        wait_for(lambda number=number: len(made.local.published) == number)
    wait_for(lambda: made.segments.published)
    give_time()
    assert [len(message.ranges) for message in made.local.published] == [1, 2, 3, 4, 5]
    assert 1 <= len(made.segments.published) <= 2       # one period of slack absorbs jitter


def test_derived_messages_need_no_operator(make: Make) -> None:
    made = make(Maker, DerivedStream, scan_topic='/obstacles')
    assert made.local.name == '/obstacles'
    made.segments.listeners = 0
    made.stream.receive(cloud(1))
    wait_for(lambda: made.local.published)
    made.local.listeners = 0
    made.stream.receive(cloud(2))
    give_time()
    assert len(made.local.published) == 1 and made.stream.sent == 0


def test_protected_messages_leave_at_once(make: Make, logged: List[str]) -> None:
    made = make(Protected, RelayStream)
    assert made.source.options['queue_size'] == 100
    made.link.datagram_size = 736
    made.link.outbox.change(lambda scheduler: scheduler.set_rate(1.0, time.monotonic()))
    for number in (5, 6):
        made.stream.receive(scan(number))
        wait_for(lambda number=number: made.segments.published[-2:] == [number] * 2)
    wait_for(lambda: made.stream.sent == 4)
    assert made.stream.encoder.calls == [1472, 1472]
    wait_for(lambda: logged == ["stream 'scan', /in: half of it is missing"])
    assert made.link.outbox.protected > 0 and made.stream.demand(0.0) is None


def test_a_stream_that_is_no_longer_protected_has_a_share_of_the_link(make: Make) -> None:
    made = make(Protected, RelayStream)
    made.link.datagram_size = 736
    for number in (100, 5):
        made.stream.receive(scan(number))
        wait_for(lambda number=number: made.segments.published[-2:] == [number] * 2)
    assert made.stream.encoder.calls == [1472, 736] and made.link.outbox.protected == 0
    assert made.segments.options['tos'] == 0xba and made.segments.tos == 0x6a   # EF, then AF31; both with ECT(0)
    wait_for(lambda: made.stream.sent == 2)
    assert made.stream.demand(0.0).points[-1].cost == 1000 * made.stream.settings.current['rate']
