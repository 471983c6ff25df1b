# SPDX-License-Identifier: BSD-3-Clause
"""Images that are predicted from what all operators hold, from the robot's encoder to the operators' screens."""
import math
import zlib
from random import Random
from typing import Any, Collection, Dict, Optional, Tuple

import needs_numba  # noqa: F401
import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as settings_of_property
from hypothesis import strategies as st
from layered_operator import pixels_of
from layered_sender import BAD, CASES, NO_LOSS, photograph
from predicted_link import PredictedLink, everything, nothing

from smokebot_udp.codecs.layered import blend
from smokebot_udp.codecs.layered.image import read
from smokebot_udp.codecs.layered.pieces import Layer, Restorer
from smokebot_udp.codecs.layered.quality import from_byte
from smokebot_udp.streams.held import Holding
from smokebot_udp.streams.image.held_by_all import TIMEOUT
from smokebot_udp.streams.image.layered_receiver import MISTRUST

TYPES = {'mono8': np.uint8, 'mono16': np.uint16, 'bgr8': np.uint8}


def independent(ratio: float, seed: int) -> Any:
    """A Loss that loses this part of the datagrams."""
    random = Random(seed)
    return lambda _, count: [number for number in range(count) if random.random() >= ratio]


def moving(step: int, encoding: str = 'mono16', pixels_an_image: int = 1) -> Any:
    """The scene after `step` images."""
    high = 2000 if encoding == 'mono16' else 255
    scene = photograph(96, 256, 3 if encoding == 'bgr8' else 1, high)
    return scene[:, pixels_an_image * step % 128:][:, :128].astype(TYPES[encoding])


def noisy(step: int, encoding: str = 'mono16') -> Any:
    """A scene that stands still before a sensor with noise."""
    noise = np.random.RandomState(step).randint(0, 4, CASES[encoding].shape)
    return np.clip(CASES[encoding].astype(int) + noise, 0, np.iinfo(TYPES[encoding]).max).astype(TYPES[encoding])


# what pays

def test_while_predictions_save_little_four_of_five_images_have_none() -> None:
    scene, link = photograph(96, 128, 1, 2000).astype(int), PredictedLink(max_bytes=20000)
    for step in range(24):
        link.send((scene + np.random.RandomState(step).randint(0, 400, scene.shape)).astype(np.uint16), 'mono16')
    assert sum(link.predicted[4:]) <= 4
    for _ in range(12):
        link.send(scene.astype(np.uint16), 'mono16')
    assert all(link.predicted[-6:])


# a scene that stands still

@pytest.mark.parametrize('encoding', CASES)
@pytest.mark.parametrize('loss, delay', [(0.0, 0), (0.0, 2), (0.2, 1)])
def test_a_scene_that_stands_still_becomes_exact_and_stays_so(encoding: str, loss: float, delay: int) -> None:
    pixels = CASES[encoding]
    link = PredictedLink(delay=delay, outlook=BAD if loss else NO_LOSS, max_bytes=pixels.nbytes // 5)
    lost, exact, announced = independent(loss, 1), [], []
    for _ in range(40 + 20 * delay):
        shown = link.send(pixels, encoding, lost)['/operator']
        if shown is not None:
            exact.append(bool((pixels_of(shown, pixels.dtype) == pixels).all()))
            announced.append(shown.error.rms == 0)
    first = exact.index(True)
    assert all(exact[first:]) and len(exact) - first > 5
    assert announced[-1] and all(true for true, said in zip(exact, announced) if said)
    assert sum(records['data'].nbytes for records in link.sent[-5:]) < pixels.nbytes / 5


def on_its_way(link: PredictedLink, delay: int) -> Any:
    """For each image, whether its reference is one of which no report can have come."""
    return [step - 1 - delay < int(records['reference'][0]) < step for step, records in enumerate(link.sent)]


def test_a_scene_that_stands_still_is_refined_before_reports_come() -> None:
    """As many images make it exact, or nearly, as where each report comes before the next image."""
    pixels, needed = CASES['mono16'], []
    for delay in (0, 2, 4):
        link, exact = PredictedLink(delay=delay, max_bytes=pixels.nbytes // 12), False
        while not exact:
            shown = link.send(pixels, 'mono16')['/operator']
            assert shown is not None
            exact = bool((pixels_of(shown) == pixels).all())
        needed.append(len(link.sent))
        assert any(on_its_way(link, delay)) == (delay > 0)
        for _ in range(delay + 1):      # what is exact is never risked
            link.send(pixels, 'mono16')
        for _ in range(4):
            link.send(pixels, 'mono16')
            assert not on_its_way(link, delay)[-1]
    assert max(needed) <= needed[0] + 4 + 1


@pytest.mark.parametrize('scene', [moving, noisy])
def test_where_nothing_is_lost_what_moves_or_has_noise_is_predicted_before_reports_come(scene: Any) -> None:
    link = PredictedLink(delay=2, max_bytes=3000)
    for step in range(12):
        assert link.send(scene(step), 'mono16')['/operator'] is not None
    assert any(on_its_way(link, 2))


def test_where_much_is_lost_what_moves_fast_is_predicted_from_what_is_held_only() -> None:
    """A lost image would cost more than it is the better reference by."""
    link = PredictedLink(delay=2, outlook=BAD, max_bytes=12000)
    for step in range(12):
        link.send(moving(step, 'mono16', 8), 'mono16')
    assert any(link.predicted) and not any(on_its_way(link, 2))


def test_while_reports_are_missing_nothing_is_predicted_from_what_is_on_its_way() -> None:
    link = PredictedLink(delay=1, max_bytes=1500)
    for step in range(14):
        link.send(moving(step), 'mono16', everything, ['/operator'] if step >= 8 else [])
    assert any(on_its_way(link, 1)[:8])
    assert not any(records['picture'][0] - 1 == records['reference'][0] for records in link.sent[-2:])


def test_an_image_that_is_lost_while_nothing_moves_costs_those_that_are_on_their_way() -> None:
    delay = 2
    link, shown = PredictedLink(delay=delay, max_bytes=1200), []
    for step in range(24):
        loss = nothing if step == 10 else everything
        shown.append(link.send(moving(0), 'mono16', loss)['/operator'] is not None)
    lost = [step for step, seen in enumerate(shown) if not seen]
    assert lost == [10, 11, 12] and link.operators['/operator'].dropped == {'reference': delay}
    assert any(on_its_way(link, delay)[14:])


def test_an_image_that_has_not_left_when_the_next_one_is_made_is_not_its_reference() -> None:
    link, shown = PredictedLink(delay=2, max_bytes=1200), []
    for step in range(16):
        link.encoder.see(unsent=step == 11)     # 10 never leaves
        shown.append(link.send(moving(0), 'mono16', nothing if step == 10 else everything)['/operator'] is not None)
    assert [step for step, seen in enumerate(shown) if not seen] == [10]
    assert on_its_way(link, 2)[12]


def test_a_report_that_is_lost_while_nothing_moves_costs_no_image() -> None:
    link = PredictedLink(delay=1, max_bytes=1500)
    for step in range(16):
        reports = ['/operator'] if step in (6, 7, 10) else []
        assert link.send(moving(0), 'mono16', everything, reports)['/operator'] is not None


# whatever is lost

def layers_restored(records: Any, layers: int, models: Dict[Tuple[int, int], Any]) -> Optional[Any]:
    """The pixels that the first layers of an image restore, by their bytes alone; None: nothing.

    :param models: {(number, layers): the pixels of an earlier image}
    """
    record = records[0]
    table = [Layer(*layer) for layer in zip(record['thresholds'].tolist(), record['sizes'].tolist())]
    restorer = Restorer(len(records), table)
    restorer.add(records['index'].astype(int), records['data'])
    data = restorer.restored()[:sum(layer.length(len(records)) for layer in table[:layers])]
    predicted = None
    if record['reference'] != record['picture']:
        length = data[0]
        course, data = blend.from_bytes(data[1:1 + length]), data[1 + length:]
        reference = other = models[int(record['reference']), int(record['reference_layers'])]
        if course.second is not None:
            other = models[int(record['picture']) - course.second.back, course.second.layers]
            assert course.second.checksum == zlib.crc32(other.tobytes())
        predicted = blend.predicted(course, reference, other)
    found = read(data, int(record['height']), int(record['width']), 1, 2, predicted)
    return None if found is None else found.prefixes.pixels(len(data))


@settings_of_property(max_examples=15)
@given(st.integers(0, 2 ** 32 - 1), st.sampled_from([0.1, 0.4, 0.7]), st.integers(0, 2), st.integers(0, 2))
def test_whatever_is_lost_both_sides_agree(seed: int, ratio: float, delay: int, pixels_an_image: int) -> None:
    """References have the same pixels on both sides, and what an operator has reported is never counted as missing."""
    random = Random(seed)
    # all within TIMEOUT: nobody is left out as silent
    link = PredictedLink(('/one', '/two'), delay, BAD, 0.05, max_bytes=6000)
    lost, models = independent(ratio, seed), {}     # type: Any, Dict[Tuple[int, int], Any]
    dropped = {name: 0 for name in link.operators}
    for step in range(14):
        unreported = [name for name in link.operators if random.random() < ratio]
        shown = link.send(moving(step, 'mono16', pixels_an_image), 'mono16', lost, unreported)
        records = link.sent[-1]
        record = records[0]
        if record['reference'] != record['picture']:
            reference = models[int(record['reference']), int(record['reference_layers'])]
            assert record['checksum'] == zlib.crc32(reference.tobytes())
        for layers in range(1, len(record['sizes']) + 1):
            models[step, layers] = layers_restored(records, layers, models)
        for name, assembled in shown.items():
            if assembled is not None and assembled.error.rms == from_byte(int(record['errors'][-1])):
                assert (pixels_of(assembled) == models[step, len(record['sizes'])]).all()
            without = link.operators[name].dropped.get('reference', 0)
            held = link.reported[name].layers_of(int(record['reference'])) if name in link.reported else 0
            assert without == dropped[name] or held < record['reference_layers']
            dropped[name] = without


def test_an_operator_that_has_forgotten_all_sees_an_image_as_soon_as_it_has_reported() -> None:
    link = PredictedLink()
    for step in range(3):
        link.send(noisy(step), 'mono16')
    link.join('/operator')
    assert link.send(noisy(3), 'mono16') == {'/operator': None}
    assert link.operators['/operator'].dropped == {'reference': 1}
    assert link.send(noisy(4), 'mono16')['/operator'] is not None and link.predicted[3:] == [True, False]
    link.send(noisy(5), 'mono16')
    assert link.predicted[5:] == [True]


def test_a_newcomer_gets_an_image_at_once_and_the_others_go_on() -> None:
    link = PredictedLink()
    for step in range(3):
        link.send(noisy(step), 'mono16')
    link.join('/late')
    for step in range(3, 6):
        assert all(shown is not None for shown in link.send(noisy(step), 'mono16').values())
    assert link.predicted == [False, True, True, False, True, True]


def test_who_does_not_report_does_not_ruin_the_images_of_the_others() -> None:
    link, shown = PredictedLink(('/one', '/mute')), []
    for step in range(40):
        shown.append(link.send(noisy(step), 'mono16', reports=['/mute']))
    assert all(images['/one'] is not None for images in shown)
    silent = int(TIMEOUT / link.period) + 1
    assert not any(link.predicted[:silent])
    assert link.predicted[silent] and link.predicted[silent:].count(False) == 2
    seen = [step for step, images in enumerate(shown) if images['/mute'] is not None]
    assert max(later - earlier for earlier, later in zip(seen, seen[1:])) <= 1 / link.period + 1


def test_a_link_that_was_cut_begins_without_a_reference() -> None:
    link = PredictedLink()
    for step in range(3):
        link.send(noisy(step), 'mono16')
    for step in range(3, 18):
        link.send(noisy(step), 'mono16', nothing)
    assert link.send(noisy(18), 'mono16')['/operator'] is not None
    assert not link.predicted[-1]


def test_a_reference_that_differs_is_not_used_and_not_trusted_for_a_while() -> None:
    link = PredictedLink()
    link.send(noisy(0), 'mono16')
    link.send(noisy(1), 'mono16', nothing)
    forged = link.sent[1].copy()
    assert forged['reference'][0] != forged['picture'][0]
    forged['checksum'] ^= 1
    forged['header']['stamp']['secs'] += 1
    operator = link.operators['/operator']
    assert operator(forged, link.now) == [] and operator.dropped == {'reference': 1}
    assert operator.assembler.holding() == Holding(int(forged['session'][0]), ())
    begun, step = link.now, 2
    while link.now < begun + MISTRUST + 1:
        link.now += 1       # stamps after the forged one
        assert link.send(noisy(step), 'mono16')['/operator'] is not None
        step += 1
    assert link.predicted[1] and link.predicted[-1] and not any(link.predicted[3:7])


def test_images_of_another_size_or_encoding_begin_another_session() -> None:
    link = PredictedLink()
    link.send(noisy(0), 'mono16')
    link.send(noisy(1), 'mono16')
    link.send(noisy(2, 'mono8'), 'mono8')
    link.send(noisy(3, 'mono8')[:90], 'mono8')
    link.send(noisy(4, 'mono8')[:90], 'mono8')
    assert link.predicted == [False, True, False, False, True]
    sessions = [int(records['session'][0]) for records in link.sent]
    assert sessions[0] == sessions[1] and sessions[3] == sessions[4] and len(set(sessions)) == 3


# what it is good for

def test_a_scene_that_moves_slowly_is_better_predicted() -> None:
    def error(reports: Collection[str]) -> float:
        link, errors = PredictedLink(max_bytes=2000), []
        for step in range(8):
            shown = link.send(moving(step), 'mono16', everything, reports)['/operator']
            errors.append(np.square(pixels_of(shown).astype(float) - moving(step)).mean())
        return float(np.mean(errors[3:]))
    assert 10 * np.log10(error(['/operator']) / error([])) > 3


def second_of(records: Any) -> Optional[blend.Second]:
    """The second reference of an image, whose datagrams all came; None: it has none."""
    record = records[0]
    table = [Layer(*layer) for layer in zip(record['thresholds'].tolist(), record['sizes'].tolist())]
    restorer = Restorer(len(records), table)
    restorer.add(records['index'].astype(int), records['data'])
    data = restorer.restored()
    return blend.from_bytes(data[1:1 + data[0]]).second


def test_noise_is_predicted_from_two_images_that_are_held() -> None:
    link = PredictedLink(delay=1, max_bytes=12000)
    for step in range(10):
        assert link.send(noisy(step), 'mono16')['/operator'] is not None
    seconds = [second_of(records) for records in link.sent[4:]]
    assert [second.back if second else 0 for second in seconds] == [3] * 6


def test_a_second_reference_that_differs_is_not_used_and_not_trusted() -> None:
    link = PredictedLink(max_bytes=12000)
    for step in range(6):
        link.send(noisy(step), 'mono16', nothing if step == 5 else everything)
    records, operator = link.sent[5].copy(), link.operators['/operator']
    second = second_of(records)
    assert second is not None
    forged = second.checksum.to_bytes(4, 'little')
    for record in records:      # each datagram that has it in a source piece
        record['data'] = np.frombuffer(record['data'].tobytes().replace(forged, bytes(4)), np.uint8)
    assert operator(records, link.now) == [] and operator.dropped == {'reference': 1}
    assert operator.assembler.holding() == Holding(int(records['session'][0]), ())


def test_images_that_are_all_different_are_no_worse_for_being_predicted() -> None:
    images = [np.kron(np.random.RandomState(seed).randint(0, 256, (12, 16)), np.ones((8, 8))).astype(np.uint8)
              for seed in range(8)]
    errors = []
    for delay in (0, 100):      # of reports: without any nothing is predicted
        link = PredictedLink(max_bytes=4000, delay=delay)
        shown = [link.send(pixels, 'mono8')['/operator'] for pixels in images]
        errors.append(math.log10(sum(one.error.rms ** 2 for one in shown)))
    assert not any(link.predicted) and errors[0] < errors[1] + 0.03


def test_a_coarse_image_is_a_reference_too() -> None:
    """Else images that are too short for a fine one would never be predicted, and stay coarse."""
    scene = np.kron(np.random.RandomState(1).randint(0, 256, (24, 40)), np.ones((4, 4))).astype(np.uint8)
    link, errors = PredictedLink(max_bytes=700), []
    for step in range(12):
        shown = link.send(scene[:, step // 2:][:, :128], 'mono8')['/operator']
        errors.append(shown.error.rms)
    assert all(link.predicted[1:]) and errors[-1] < 0.5 * errors[0]


def test_an_image_without_a_reference_after_tiny_ones_has_its_full_size() -> None:
    """Who joins while nothing changes sees as much as the first one did."""
    pixels = CASES['mono16']
    link = PredictedLink(outlook=NO_LOSS._replace(room=1e6))
    for _ in range(6):
        link.send(pixels, 'mono16')
    assert link.sent[-1].nbytes < 1000
    link.join('/late')
    shown = link.send(pixels, 'mono16')['/late']
    assert not link.predicted[-1] and shown.error.rms < 1


def test_what_moves_after_a_standstill_has_its_full_size_at_once() -> None:
    link = PredictedLink(outlook=NO_LOSS._replace(room=1e6), rate=10.0)
    for _ in range(6):
        link.send(moving(0), 'mono16')
    assert link.sent[-1].nbytes < 1000
    shown = link.send(moving(1), 'mono16')['/operator']
    assert shown.error.rms < 2


def test_depth_is_predicted_where_it_is_finite() -> None:
    depth = (moving(0) / np.float32(4000)).astype(np.float32)
    depth[10:20, 30:50], depth[40, 60:90] = np.nan, np.inf
    link = PredictedLink(depth_unit=0.001, max_bytes=3000)
    for step in range(20):
        depth[10:20, 30 + step] = 1.0
        shown = link.send(depth, '32FC1')['/operator']
    assert any(link.predicted)
    found = pixels_of(shown, np.float32)
    finite = np.isfinite(depth)
    np.testing.assert_array_equal(np.where(finite, 0, found), np.where(finite, 0, depth))
    assert np.abs(found[finite] - depth[finite]).max() < 0.01


# impossible heads

@pytest.mark.parametrize('changes', [
    {'reference': 6}, {'reference': 4}, {'reference': 4, 'reference_layers': 15}, {'reference_layers': 1},
    {'checksum': 1}])
def test_an_impossible_reference_is_refused(changes: Dict[str, int]) -> None:
    link = PredictedLink()
    link.send(CASES['mono8'], 'mono8', nothing)
    records = link.sent[0].copy()
    records['picture'] = records['reference'] = 5
    for field, value in changes.items():
        records[field] = value
    operator = link.operators['/operator']
    assert operator(records, 1.0) == [] and set(operator.dropped) == {'impossible head'}
