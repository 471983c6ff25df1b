# SPDX-License-Identifier: BSD-3-Clause
import threading
import time
from typing import Any

import numpy as np
import pytest
import rospy
from polling import WAIT, give_time, wait_for
from std_msgs.msg import Header

from smokebot_udp.codecs.display.colouring import Coloured, Colouring
from smokebot_udp.codecs.display.view import COLOURS, FRESH, FROZEN, OLD
from smokebot_udp.image_error import ImageError
from smokebot_udp.mission.parameters import check
from smokebot_udp.nodes import view_publisher, worker
from smokebot_udp.streams.image import view

PICTURE = np.full((1, 1), 7000, np.uint16)


class FakePublisher:
    made = None

    def __init__(self, topic, message_class, **options) -> None:
        self.name, self.connections, self.sent = topic, 1, []
        self.changed = threading.Condition()
        FakePublisher.made = self

    def get_num_connections(self) -> Any:
        return self.connections

    def publish(self, message) -> None:
        with self.changed:
            self.sent.append(message)
            self.changed.notify()

    def unregister(self) -> None:
        self.connections = 0

    def wait_for_frame(self, frame='thermal') -> Any:
        """The index of the first message with this frame_id."""
        def index() -> Any:
            return next((i for i, m in enumerate(self.sent) if m.header.frame_id == frame), None)
        with self.changed:
            assert self.changed.wait_for(lambda: index() is not None, WAIT)
        return index()

    def wait_for(self, count) -> Any:
        with self.changed:
            assert self.changed.wait_for(lambda: len(self.sent) >= count, WAIT)
        return self.sent


@pytest.fixture
def publisher(monkeypatch) -> Any:
    monkeypatch.setattr(view_publisher.rospy, 'Publisher', FakePublisher)
    monkeypatch.setattr(view, 'REMIND_PERIOD', 0.05)
    made = []

    def make(connections=1, offset=0.0, **settings) -> Any:
        settings = {**defaults(), 'view_topic': 'view', **settings}
        monkeypatch.setattr(FakePublisher, 'get_num_connections', lambda self: connections)
        made.append(view_publisher.ViewPublisher(settings, lambda: offset, 'camera'))
        return made[-1]
    yield make
    for one in made:
        one.close()


class Clock:
    """Stands still until a test moves it: on a machine that stalls, an image grows old no sooner."""

    def __init__(self) -> None:
        self.now = 1000.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch) -> Clock:
    """That of views and their threads."""
    made = Clock()
    for module in (view_publisher, worker):
        monkeypatch.setattr(module, 'time', made)
    return made


def header(stamp=100.0, frame='thermal') -> Any:
    return Header(stamp=rospy.Time.from_sec(stamp), frame_id=frame)


def state(message) -> Any:
    picture = np.frombuffer(message.data, np.uint8).reshape(message.height, message.width, 3)
    colours = {tuple(picture[0, 0].tolist()), tuple(picture[-1, 0].tolist())}
    assert len(colours) == 1 and message.encoding == 'bgr8' and message.step == 3 * message.width
    colour = colours.pop()
    return next(name for name, value in COLOURS.items() if value == colour)


def test_no_data_yet(publisher) -> None:
    publisher()
    first, second = FakePublisher.made.wait_for(2)[:2]
    assert state(first) == state(second) == FROZEN and first.header.frame_id == 'camera'


def test_a_picture_comes_out_at_once_and_grows_old(publisher, clock) -> None:
    views, source = publisher(old_after=0.1, frozen_after=0.2), header()
    views.show(PICTURE, 'mono16', source, 1.0, 100.0)
    at = FakePublisher.made.wait_for_frame()
    first = FakePublisher.made.sent[at]
    assert state(first) == FRESH and first.header.frame_id == 'thermal' and first.header is not source
    clock.now += 0.09
    give_time(0.15)
    assert len(FakePublisher.made.sent) == at + 1
    for expected in (OLD, FROZEN):
        clock.now += 0.08
        wait_for(lambda name=expected: state(FakePublisher.made.sent[-1]) == name)
    sent = FakePublisher.made.sent[at + 1:]
    states = [state(message) for message in sent]
    assert states == sorted(states, reverse=True) and set(states) == {OLD, FROZEN}
    assert all(message.header.stamp == source.stamp for message in sent)


def test_an_image_of_another_epoch_is_as_old_as_its_arrival(publisher) -> None:
    views = publisher(old_after=0.5, frozen_after=2.0)
    views.show(PICTURE, 'mono16', header(7.0), 1.0, 100.0, arrival=int(99.9e9))
    at = FakePublisher.made.wait_for_frame()
    assert state(FakePublisher.made.sent[at]) == FRESH and FakePublisher.made.sent[at].header.stamp.secs == 7


def test_it_grows_old_from_the_age_at_which_it_came(publisher, clock) -> None:
    views = publisher(old_after=0.2, frozen_after=9.0)
    views.show(PICTURE, 'mono16', header(), 1.0, 108.0)
    at = FakePublisher.made.wait_for_frame()
    clock.now += 0.9
    FakePublisher.made.wait_for(at + 2)
    assert {state(message) for message in FakePublisher.made.sent[at:]} == {OLD}
    clock.now += 0.2
    wait_for(lambda: state(FakePublisher.made.sent[-1]) == FROZEN)


def test_a_stream_that_runs_is_published_once_each(publisher, clock) -> None:
    views = publisher(old_after=5.0, frozen_after=9.0)
    for turn in range(20):
        views.show(PICTURE, 'mono16', header(100.0 + turn), 1.0, 100.1 + turn)
        FakePublisher.made.wait_for_frame()
        wait_for(lambda turn=turn: FakePublisher.made.sent[-1].header.stamp.to_sec() == 100 + turn)
    states = [state(message) for message in FakePublisher.made.sent if message.header.frame_id == 'thermal']
    assert states == [FRESH] * 20


def test_a_slow_viewer_does_not_hold_up_who_shows(publisher, monkeypatch) -> None:
    views, drawing, go = publisher(), threading.Event(), threading.Event()
    grey = Coloured(np.full((480, 640, 3), 100, np.uint8))
    monkeypatch.setattr(Colouring, '__call__', lambda *source: drawing.set() or (go.wait(WAIT) and grey))
    for turn in range(3):
        began = time.monotonic()
        views.show(PICTURE, 'mono16', header(100.0 + turn), 1.0, 100.1 + turn)
        assert time.monotonic() - began < WAIT / 2       # and not until it is drawn
        assert drawing.wait(WAIT)
    go.set()
    wait_for(lambda: FakePublisher.made.sent and FakePublisher.made.sent[-1].header.stamp.to_sec() == 102)
    stamps = {message.header.stamp.to_sec() for message in FakePublisher.made.sent}
    assert stamps <= {0.0, 100.0, 102.0}      # 101 was never the newest when there was time for it


@pytest.mark.parametrize('offset, now, expected', [(5.0, 95.1, FRESH), (0.0, 95.1, OLD), (-3.0, 103.1, FRESH),
                                                   (0.0, 103.1, FROZEN)])
def test_the_robots_clock(publisher, clock, offset, now, expected) -> None:
    views = publisher(offset=offset, old_after=1.9)
    views.show(np.uint8([[7]]), 'mono8', header(), 1.0, now)
    assert state(FakePublisher.made.sent[FakePublisher.made.wait_for_frame()]) == expected


def test_nobody_looks_and_then_somebody_does(publisher, clock, monkeypatch) -> None:
    views = publisher(connections=0)
    drawn = []
    monkeypatch.setattr(view, 'framed', lambda *args, draw=view.framed: drawn.append(args) or draw(*args))
    for _ in range(3):
        views.show(PICTURE, 'mono16', header(), 1.0, 100.1)
    clock.now += 0.15
    give_time(0.15)
    assert not FakePublisher.made.sent and not drawn
    views.configure({**defaults(), 'old_after': 0.1}, {'old_after': 0.1})
    monkeypatch.setattr(FakePublisher, 'get_num_connections', lambda self: 1)
    message, = FakePublisher.made.wait_for(1)[:1]
    assert state(message) == OLD and message.header.frame_id == 'thermal'


def defaults() -> Any:
    return check({}, view.PARAMETERS)


def test_a_picture_that_cannot_be_shown_does_not_keep_the_last_one_alive(publisher, monkeypatch) -> None:
    errors = []
    monkeypatch.setattr('smokebot_udp.nodes.view_publisher.logerr', lambda topic, problem: errors.append(problem))
    views = publisher(old_after=0.1, frozen_after=0.2)
    views.show(PICTURE, 'mono16', header(), 1.0, 100.1)
    FakePublisher.made.wait_for_frame()

    def is_frozen() -> bool:
        before = len(errors)
        views.show(PICTURE, 'yuv422', header(101.0), 1.0, 101.1)
        wait_for(lambda: len(errors) > before)
        views.show(PICTURE, 'mono16', header(101.0), 2.0, 101.1)
        wait_for(lambda: len(errors) > before + 1)
        return bool(state(FakePublisher.made.sent[-1]) == FROZEN)

    wait_for(is_frozen)
    assert FakePublisher.made.sent[-1].header.stamp.to_sec() == 100.0
    assert {text.split()[5] for text in errors} == {'encoding', 'completeness'}


def test_settings_change_while_it_runs(publisher, clock) -> None:
    views = publisher()
    views.configure({**defaults(), 'old_after': 0.05}, {'old_after': 0.05})
    views.show(PICTURE, 'mono16', header(), 1.0, 100.1)
    assert state(FakePublisher.made.sent[FakePublisher.made.wait_for_frame()]) == OLD


def test_closed_it_is_silent(publisher) -> None:
    views = publisher()
    views.close()
    count = len(FakePublisher.made.sent)
    give_time(0.15)
    assert len(FakePublisher.made.sent) == count


def test_a_display_that_draws_its_own_gets_the_parts() -> None:
    pixels = np.arange(7000, 7600, 100, np.uint16).reshape(2, 3)
    image = view.ViewedImage(Header(frame_id='thermal'), 0.9, 0.1, 10.0, pixels, 'mono16', error=ImageError(10.0))
    settings = {**defaults(), 'counts_per_unit': 25.0, 'zero': -273.15, 'unit': 'degC'}
    shown = view.View(settings, Header())
    parts = view_publisher.view_image(image.header, image, shown.judge(image, 10.0), settings)
    assert (parts.state, parts.unit, parts.error, parts.height, parts.width) == ('fresh', 'degC', 0.4, 2, 3)
    assert len(parts.data) == 18 and len(parts.palette) == 3 * view_publisher.COLOURS and len(parts.numbers) == 5
    frozen = view_publisher.view_image(image.header, image, shown.judge(image, 20.0), settings)
    assert frozen.state == 'frozen' and frozen.old and set(frozen.data) != set(parts.data)
