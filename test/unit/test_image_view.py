# SPDX-License-Identifier: BSD-3-Clause
"""When which image is drawn; without threads."""
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from smokebot_udp.codecs.display.view import COLOURS, FRESH, FROZEN, OLD
from smokebot_udp.image_error import ImageError
from smokebot_udp.mission.parameters import check, live
from smokebot_udp.mission.settings import SettingsStore
from smokebot_udp.streams.image.assembler import ImageAssembler
from smokebot_udp.streams.image.view import PARAMETERS, REMIND_PERIOD, View, ViewedImage

HEADER = SimpleNamespace(frame_id='before')


def view(**settings: Any) -> View:
    return View(check(settings, PARAMETERS), HEADER)


def image(received: float, age: float = 0.1, value: int = 7000, encoding: str = 'mono16') -> ViewedImage:
    return ViewedImage(SimpleNamespace(frame_id='thermal'), 1.0, age, received, np.full((4, 4), value, np.uint16),
                       encoding)


def state(drawn: Any) -> str:
    return next(name for name, colour in COLOURS.items() if tuple(drawn[0, 0].tolist()) == colour)


def next_drawn(shown: View, now: float, wanted: bool = True) -> Any:
    """What is due at a time, drawn: (image, state); None where nothing is."""
    due = shown.poll(now, wanted)
    return due and (due, state(shown.draw(due, now)))


def test_before_the_first_image_a_placeholder_says_so() -> None:
    shown = view()
    first, first_state = next_drawn(shown, 10.0)
    assert first.header is HEADER and first_state == FROZEN
    assert shown.poll(10.1, True) is None and shown.deadline() == 10.0 + REMIND_PERIOD
    assert next_drawn(shown, 10.0 + REMIND_PERIOD) == (first, FROZEN)


def test_an_image_is_drawn_once_and_again_when_it_grows_old() -> None:
    shown, new = view(old_after=0.5, frozen_after=2.0), image(10.0, age=0.1)
    shown.add(new)
    assert next_drawn(shown, 10.0) == (new, FRESH)
    times, states = [], []
    for _ in range(6):
        now = shown.deadline()
        assert shown.poll(now - 1e-6, True) is None
        times.append(now)
        states.append(next_drawn(shown, now)[1])
    # frozen when it is 2 s old: it was 0.1 s when it was received
    assert times == pytest.approx([10.5, 11.0, 11.5, 11.9, 12.4, 12.9])
    assert states == [OLD] * 3 + [FROZEN] * 3


def test_of_images_that_come_faster_only_the_newest_is_drawn() -> None:
    shown, newest = view(), image(10.2)
    for one in image(10.0), image(10.1), newest:
        shown.add(one)
    assert next_drawn(shown, 10.2) == (newest, FRESH) and shown.poll(10.2, True) is None


def test_without_viewers_nothing_is_drawn_and_late_ones_see_the_newest() -> None:
    shown, new = view(old_after=0.5), image(10.0)
    shown.add(new)
    for now in np.arange(10.0, 13.0, 0.1):
        assert shown.poll(float(now), False) is None
        assert shown.deadline() <= max(now, 10.5) + REMIND_PERIOD
    assert next_drawn(shown, 13.0) == (new, FROZEN)


def test_an_image_that_cannot_be_drawn_does_not_keep_the_last_one_alive() -> None:
    shown, good = view(old_after=0.2, frozen_after=0.4), image(10.0)
    shown.add(good)
    assert next_drawn(shown, 10.0) == (good, FRESH)
    states = []
    for now in np.arange(10.02, 11.5, 0.02).tolist():
        shown.add(image(now, encoding='yuv422'))
        bad = shown.poll(now, True)
        assert bad is not None and bad is not good
        with pytest.raises(ValueError, match='encoding'):
            shown.draw(bad, now)
        due = next_drawn(shown, now + 0.01)
        if due:
            assert due[0] is good
            states.append(due[1])
    assert states[0] == OLD and set(states[1:]) == {FROZEN} and len(states) >= 3


def test_limits_that_change_show_at_once() -> None:
    shown = view(old_after=0.5, frozen_after=2.0)
    shown.add(image(10.0))
    assert next_drawn(shown, 10.0)[1] == FRESH and next_drawn(shown, 10.5)[1] == OLD
    shown.configure(check({'frozen_after': 0.3}, PARAMETERS), {'frozen_after': 0.3})
    assert next_drawn(shown, 10.6)[1] == FROZEN


@pytest.mark.parametrize('rms, least_psnr, expected', [(8.0, 20.0, OLD), (8.0, 10.0, FRESH), (0.0, 100.0, FRESH)])
def test_the_error_of_a_layered_image_is_judged(rms: float, least_psnr: float, expected: str) -> None:
    """The colours of this image span 35 counts."""
    shown, new = view(least_psnr=least_psnr), image(10.0)
    new.error = ImageError(rms)
    shown.add(new)
    assert next_drawn(shown, 10.0) == (new, expected)


def test_an_image_of_which_nothing_came_leaves_the_old_one_to_grow_old() -> None:
    """The view is not told of a layered image of which nothing can be restored."""
    shown, good = view(old_after=0.2, frozen_after=0.4), image(10.0)
    good.error = ImageError(0.0)
    shown.add(good)
    assert [next_drawn(shown, now)[1] for now in (10.0, 10.25, 10.8)] == [FRESH, OLD, FROZEN]


def drawn_after(*changes: Any) -> Any:
    """The view of the second of two images, between which settings of the stream change."""
    values = check({'operator_topic': '/out', 'view_topic': 'view'}, ImageAssembler.PARAMETERS)
    store = SettingsStore(live(ImageAssembler.PARAMETERS), values)
    shown = View(store.current, HEADER)
    store.subscribe(shown.configure)
    for received, low, high in ((10.0, 7000, 9000), (10.1, 7400, 7600)):
        shown.add(ViewedImage(HEADER, 1.0, 0.1, received, np.linspace(low, high, 10000).reshape(100, 100).astype('u2'),
                              'mono16'))
        due = shown.poll(received, True)
        assert due is not None
        drawn = shown.draw(due, received)
        if received == 10.0:
            for change in changes:
                store.request(change)
    return drawn


@pytest.mark.parametrize('change', [{'max_wait': 0.3}, {'fill': 'nearest'}, {'integrate': 'never'},
                                    {'old_after': 0.7}, {'max_wait': 0.3, 'fill': 'nearest'}])
def test_settings_of_something_else_keep_the_automatic_range(change: Any) -> None:
    """Any live setting used to erase it."""
    assert (drawn_after(change) == drawn_after()).all()


def test_another_palette_keeps_the_automatic_range() -> None:
    there_and_back = drawn_after({'palette': 'jet'}, {'palette': 'inferno'})
    assert (there_and_back == drawn_after()).all()
    assert (drawn_after({'palette': 'jet'}) != drawn_after()).any()
    fixed_and_back = drawn_after({'range_low': 7000.0, 'range_high': 9000.0}, {'range_low': 0.0, 'range_high': 0.0})
    assert (fixed_and_back == drawn_after()).all()


def test_a_notice_is_shown_at_once_with_the_last_image() -> None:
    shown, new = view(), image(10.0)
    shown.add(new)
    plain = shown.draw(shown.poll(10.0, True), 10.0)
    shown.set_notice('EMERGENCY STOP')
    assert shown.deadline() < 10.1
    noticed = shown.draw(shown.poll(10.1, True), 10.1)
    assert shown.poll(10.11, True) is None and shown.deadline() == 10.5
    assert (plain != noticed).any() and state(noticed) == FRESH
    shown.set_notice('EMERGENCY STOP')      # the same
    assert shown.poll(10.12, True) is None


def test_a_notice_without_viewers_is_not_drawn_but_shown_by_the_next_image() -> None:
    shown = view()
    shown.set_notice('LOCKED')
    assert shown.poll(10.0, False) is None and shown.deadline() > 10.0
    shown.add(image(10.1))
    locked = shown.draw(shown.poll(10.1, True), 10.1)
    shown.set_notice('')
    assert (locked != shown.draw(shown.poll(10.1, True), 10.1)).any()


@pytest.mark.parametrize('age, state', [(0.1, 'fresh'), (1.0, 'old'), (5.0, 'frozen')])
def test_the_parts_of_a_view_say_what_it_shows(age, state) -> None:
    shown = view()
    shown.set_notice('EMERGENCY STOP')
    image = ViewedImage(HEADER, 0.9, age, 10.0, np.zeros((4, 6), np.uint8), 'mono8')
    parts = shown.judge(image, 10.0)
    assert (parts.judgement.state, parts.judgement.age, parts.judgement.quality) == (state, age, '90 %')
    assert parts.judgement.old == (state != 'fresh') and not parts.judgement.poor
    assert parts.notice == 'EMERGENCY STOP' and parts.coloured.pixels.shape == (4, 6, 3)
