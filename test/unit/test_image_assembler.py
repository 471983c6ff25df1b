# SPDX-License-Identifier: BSD-3-Clause
"""Images on the operator's side, and both sides of a stream: an encoder's datagrams to an assembler's message."""
from typing import Any, Iterator, List

import numpy as np
import pytest
from genpy import Time
from sensor_msgs.msg import Image

from evaluation.offline_link import Sender, assemble_all, operator_side
from smokebot_udp.codecs.concealment.fill import BEST, nearest
from smokebot_udp.codecs.wire.interleave import Interleave
from smokebot_udp.mission.parameters import check
from smokebot_udp.mission.settings import Settings
from smokebot_udp.streams.concealment_budget import CHEAPEST, FALLBACK
from smokebot_udp.streams.image.assembler import ImageAssembler
from smokebot_udp.streams.image.interleaved_receiver import AssembledImage


def noise(seed: int) -> Any:
    return np.random.RandomState(seed).randint(0, 65536, (120, 160)).astype(np.uint16)


def segments(pixels: Any, seconds: int) -> List[Any]:
    """[records of a frame, ...]"""
    message = Image(height=pixels.shape[0], width=pixels.shape[1], encoding='mono16', step=pixels.strides[0],
                    data=pixels.tobytes())
    message.header.stamp, message.header.frame_id = Time(seconds, 5), 'camera'
    return [frame.records for frame in Sender('image', coding='interleaved').frames(message)]


def halves(pixels: Any, seconds: int, first: int = 0) -> List[Any]:
    return [records[first::2] for records in segments(pixels, seconds) if len(records) > first]


def pixels_of(assembled: Any) -> Any:
    message = assembled.message
    return np.frombuffer(message.data, np.uint16).reshape(message.height, message.width)


def test_both_ends_agree() -> None:
    assembled, = assemble_all(*operator_side('image'), segments(noise(0), 7))
    message = assembled.message
    assert message.data == noise(0).tobytes()
    assert (message.height, message.width, message.step, message.encoding) == (120, 160, 320, 'mono16')
    assert (message.header.frame_id, message.header.stamp.to_nsec()) == ('camera', 7 * 10 ** 9 + 5)
    assert (assembled.stamp, assembled.completeness) == (7 * 10 ** 9 + 5, 1.0)
    assert isinstance(assembled, AssembledImage) and assembled.received.all() and assembled.filtered.known.all()


def test_missing_pixels_are_concealed_and_the_others_exact() -> None:
    assembled, = assemble_all(*operator_side('image', fill='nearest'), halves(noise(0), 7))
    assert isinstance(assembled, AssembledImage)
    came = assembled.received
    assert 0.4 < came.mean() < 0.6 and assembled.completeness == pytest.approx(came.mean())
    assert (pixels_of(assembled)[came] == noise(0)[came]).all()
    assert assembled.filtered.known_ratio == came.mean() and (assembled.filtered.known == came).all()
    sent = Interleave(120, 160, int(segments(noise(0), 7)[0]['depth'][0]))
    have = np.zeros(len(sent), bool)
    for records in halves(noise(0), 7):
        for index, count in zip(records['index'], records['count']):
            have[sent.positions[index] + np.arange(count)] = True
    assert (pixels_of(assembled) == sent.merge(nearest(sent.split(noise(0)), have, sent))).all()


def test_a_whole_image_is_remembered_for_the_next_one() -> None:
    assembler, settings = operator_side('image')
    first, = assemble_all(assembler, settings, segments(noise(0), 1), now=1.0, still=True)
    second, = assemble_all(assembler, settings, halves(noise(0), 2), now=2.0, still=True)
    assert second.completeness is not None and second.completeness < 0.6
    assert second.message.data == first.message.data == noise(0).tobytes()
    assert isinstance(second, AssembledImage) and second.filtered.known.all() and not second.received.all()


@pytest.mark.parametrize('integrate, still, completed', [
    ('when_still', True, True), ('when_still', False, False), ('always', False, True), ('never', True, False)])
def test_when_earlier_pixels_replace_missing_ones(integrate: str, still: bool, completed: bool) -> None:
    assembler, settings = operator_side('image', integrate=integrate)
    assemble_all(assembler, settings, segments(noise(0), 1), 1.0, still)
    assembled, = assemble_all(assembler, settings, halves(noise(0), 2), 2.0, still)
    assert isinstance(assembled, AssembledImage)
    assert (assembled.filtered.known_ratio == 1.0) == completed and (assembled.filtered.known_ratio > 0.6) == completed
    assert (pixels_of(assembled) == noise(0)).all() == completed


def test_how_much_changed_is_known_after_settling() -> None:
    assembler, settings = operator_side('image')
    changed = [assembled.changed for seed, second in ((0, 1), (0, 2), (1, 3))
               for assembled in assemble_all(assembler, settings, segments(noise(seed), second), float(second))]
    assert changed == [None, 0.0, 1.0]
    assembler, settings = operator_side('image', integrate='never')
    assert [assemble_all(assembler, settings, segments(noise(0), second))[0].changed for second in (1, 2)] == [None] * 2


def test_remembered_pixels_grow_too_old() -> None:
    assembler, settings = operator_side('image', remember=3.0)
    assemble_all(assembler, settings, segments(noise(0), 1), now=1.0, still=True)
    later, = assemble_all(assembler, settings, halves(noise(0), 5), now=5.0, still=True)
    assert isinstance(later, AssembledImage) and (later.filtered.known == later.received).all()


class SlowClock:
    """By which each concealment takes `seconds`."""

    def __init__(self) -> None:
        self.now, self.seconds = 0.0, 1.0
        self._times = self._run()

    def __call__(self) -> float:
        return next(self._times)

    def _run(self) -> Iterator[float]:
        while True:
            yield self.now
            self.now += self.seconds
            yield self.now


def test_a_concealment_that_takes_too_long_gives_way_says_so_and_comes_back() -> None:
    clock = SlowClock()
    values = Settings(check({'operator_topic': '/out', 'integrate': 'never'}, ImageAssembler.PARAMETERS))
    assembler = ImageAssembler(values, clock)
    steps = np.random.RandomState(3).choice(np.uint16([0, 1000]), (120, 160))

    def inventions(second: int, settings: Settings) -> float:
        """Share of pixels of values that were not sent: nearest invents none."""
        assembled, = assemble_all(assembler, settings, halves(steps, second))
        return float(np.mean(~np.isin(pixels_of(assembled), [0, 1000])))
    assert inventions(1, values) > 0.3 and inventions(2, values) > 0.3
    assert inventions(3, values) == 0.0
    assert assembler.problem(values, clock.now) == 'filled by %s because %s takes too long' % (CHEAPEST, BEST)
    assert not assembler.warnings       # a node that starts may take long
    patient = Settings({**values.requested, 'fill_time': 60.0})
    clock.seconds = 0.0
    assert inventions(4, patient) > 0.3 and assembler.problem(patient, clock.now) is None
    clock.seconds = 1.0
    assert [inventions(second, values) > 0.3 for second in (5, 6, 7)] == [True, True, False]
    clock.now += FALLBACK
    assert assembler.problem(values, clock.now) is None and inventions(8, values) > 0.3
    assert len(assembler.warnings) == 1 and BEST in assembler.warnings[0]


@pytest.mark.parametrize('name, value', [('height', 0), ('depth', 9), ('total', 0), ('index', 60000)])
def test_forged_segments_say_nothing_of_the_time_between_images(name: str, value: int) -> None:
    """Each concealment may take half a second for images at 1 Hz, whatever comes beside them."""
    clock = SlowClock()
    clock.seconds = 0.5
    values = Settings(check({'operator_topic': '/out', 'fill_time': 60.0}, ImageAssembler.PARAMETERS))
    assembler = ImageAssembler(values, clock)
    for second in range(1, 6):
        assembled, = assemble_all(assembler, values, halves(noise(second), second), float(second))
        for number in range(25):
            forged = segments(noise(second), second)[0][:1].copy()
            forged['header']['stamp']['nsecs'] += 1000 * (number + 1)
            forged[name] = value
            assert assemble_all(assembler, values, [forged], second + 0.5) == []
        assert assembler.problem(values, clock.now) is None and not assembler.warnings


def test_forged_segments_are_counted_and_cost_the_true_image_nothing() -> None:
    true = segments(noise(0), 7)
    forged = true[0].copy()
    assembler, settings = operator_side('image')
    batches = [true[0][:10]]
    for name, value in (('height', 4097), ('encoding', ord('x')), ('depth', 9), ('total', 0)):
        lie = forged.copy()
        lie[name] = value
        batches.append(lie)             # another head for the same stamp
        impossible = lie.copy()
        impossible['header']['stamp']['secs'] += 1
        batches.append(impossible)
    assembled, = assemble_all(assembler, settings, [*batches, true[0][10:], *true[1:]])
    assert assembled.message.data == noise(0).tobytes()
    assert assembler.dropped == {'contradiction': 4 * len(forged), 'impossible head': 4 * len(forged)}
