# SPDX-License-Identifier: BSD-3-Clause
"""The robot's side of layered images, decoded from some of the datagrams by the codec itself."""
import math

import needs_numba  # noqa: F401
import numpy as np
import pytest
from genpy import Time
from hypothesis import example, given
from hypothesis import settings as settings_of_property
from hypothesis import strategies as st
from layered_sender import (
    BAD,
    CASES,
    DATAGRAM,
    NO_LOSS,
    encoder,
    image,
    nothing_lost,
    photograph,
    received,
    rms,
    segments,
    settings,
)

from smokebot_udp.codecs.layered import quality
from smokebot_udp.streams.air import Air
from smokebot_udp.streams.image.image_size import LEAST_BYTES
from smokebot_udp.streams.outlook import Outlook
from smokebot_udp.streams.segments import size_on_air
from smokebot_udp.udpros.datagram import OVERHEAD


@pytest.mark.parametrize('encoding', CASES)
def test_a_tenth_of_the_bytes_shows_the_image_though_datagrams_are_lost(encoding: str) -> None:
    pixels, of = CASES[encoding], settings(max_bytes=6000)
    frames = encoder(of, BAD).encode(image(pixels, encoding), of, DATAGRAM)
    assert size_on_air(frames) <= 6000 and all(frame.datagram_size <= DATAGRAM for frame in frames)
    parts = segments(frames)
    assert [part.index for part in parts] == list(range(parts[0].count)) and parts[0].header.frame_id == 'lens'
    assert (parts[0].height, parts[0].width, parts[0].encoding, parts[0].depth_unit) == (96, 128, encoding, 0.0)
    every, _ = received(parts, range(len(parts)))
    most, error = received(parts, [i for i in range(len(parts)) if i % 4])
    contrast = pixels.astype(float).std()
    assert rms(every, pixels) <= rms(most, pixels) < 0.2 * contrast
    assert quality.from_byte(error) == pytest.approx(rms(most, pixels), rel=0.5)
    assert list(parts[0].errors) == sorted(parts[0].errors, reverse=True)
    assert list(parts[0].thresholds) == sorted(set(parts[0].thresholds))


@pytest.mark.parametrize('outlook', [NO_LOSS, nothing_lost()])
@pytest.mark.parametrize('encoding', CASES)
def test_a_fast_link_without_loss_shows_the_exact_image_from_the_second_one_on(encoding: str, outlook: Outlook) -> None:
    """How long a complete stream is follows from the image before."""
    pixels, of = CASES[encoding], settings()
    made = encoder(of, outlook)
    for second in (1, 2, 3):
        parts = segments(made.encode(image(pixels, encoding, second), of, DATAGRAM))
        shown, error = received(parts, range(len(parts)))
    assert (shown.pixels == pixels).all() and error == quality.EXACT
    assert made.message_size < 0.75 * pixels.nbytes


def test_what_nobody_sees_is_not_sent() -> None:
    pixels, sizes = CASES['mono8'], []
    for decibels in (0.0, 45.0, 35.0):
        of = settings(max_quality=decibels)
        made = encoder(of)
        for second in (1, 2):
            parts = segments(made.encode(image(pixels, 'mono8', second), of, DATAGRAM))
        shown, _ = received(parts, range(len(parts)))
        sizes.append(made.message_size)
        if decibels:
            assert 20 * math.log10(255 / rms(shown, pixels)) == pytest.approx(decibels, abs=2.5)
    assert sizes[1] < 0.8 * sizes[0] and sizes[2] < 0.8 * sizes[1]


def test_an_image_is_no_longer_than_the_link_carries_until_the_next_one() -> None:
    of = settings(rate=10.0)
    made = encoder(of, NO_LOSS._replace(room=20000.0))
    frames = made.encode(image(CASES['mono16'], 'mono16'), of, DATAGRAM)
    assert 1500 < size_on_air(frames) <= 2000
    rare = settings(rate=0.5)
    frames = made.encode(image(CASES['mono16'], 'mono16', 2), rare, DATAGRAM)
    assert size_on_air(frames) <= 2000      # a tenth of a second, and not two


def test_an_image_of_a_scene_that_moves_fast_is_short_on_a_slow_link_so_that_it_is_no_older() -> None:
    of, scene, sizes = settings(rate=10.0), photograph(96, 256, high=2000) + 7000, {}
    for pixels_an_image in (0, 8):
        made = encoder(of, NO_LOSS._replace(room=60000.0))
        for k in range(8):
            pixels = scene[:, pixels_an_image * k:][:, :128].astype(np.uint16)
            message = image(pixels, 'mono16')
            message.header.stamp = Time.from_sec(1 + 0.1 * k)
            frames = made.encode(message, of, DATAGRAM)
        sizes[pixels_an_image] = size_on_air(frames)
        parts = segments(frames)
        shown, _ = received(parts, range(len(parts)))
        assert (shown.pixels.astype(float) - pixels).std() < 0.2 * pixels.std()
    assert sizes[0] > 4500 and sizes[8] < 0.9 * sizes[0]


def test_on_a_fast_link_an_image_of_a_scene_that_moves_takes_little_coding_and_one_of_a_scene_that_stands_is_exact(
        ) -> None:
    """The clock is of a processor that takes 10 ms for anything."""
    now, of = iter(np.arange(0.0, 1e3, 0.01)), settings(rate=10.0)
    scene, sizes = photograph(96, 512, high=2000) + 7000, []
    made = encoder(of, NO_LOSS._replace(room=1e9), clock=lambda: float(next(now)))
    for k in range(60):
        pixels = scene[:, 8 * min(k, 20):][:, :128].astype(np.uint16)
        message = image(pixels, 'mono16')
        message.header.stamp = Time.from_sec(1 + 0.1 * k)
        frames = made.encode(message, of, DATAGRAM)
        sizes.append(size_on_air(frames))
        parts = segments(frames)
        shown, _ = received(parts, range(len(parts)))
        assert (shown.pixels.astype(float) - pixels).std() < 0.2 * pixels.std()
    assert max(sizes[10:20]) < 0.4 * sizes[0]
    np.testing.assert_array_equal(shown.pixels, pixels)


@settings_of_property(max_examples=60)
@given(st.sampled_from(['mono8', 'mono16', 'bgr8', '32FC1']), st.integers(1, 40), st.integers(1, 40),
       st.integers(1, 20000), st.integers(256, DATAGRAM), st.sampled_from([0.0, 0.3, 0.9]), st.integers(0, 9))
@example('32FC1', 18, 32, 1777, 256, 0.0, 4)    # what shows it fills more than a datagram
def test_any_image_at_any_budget(encoding: str, height: int, width: int, budget: int, size: int, loss: float,
                                 seed: int) -> None:
    random = np.random.RandomState(seed)
    pixels = random.randint(0, 256 if seed else 1, (height, width, 3)).astype(np.uint8)
    if encoding != 'bgr8':
        pixels = pixels[..., 0].astype({'mono8': np.uint8, 'mono16': np.uint16, '32FC1': np.float32}[encoding])
    if encoding == '32FC1':
        pixels[pixels < 64] = np.nan
    of = settings(max_bytes=budget, depth_unit=0.01)
    made = encoder(of, Outlook(Air({loss: 0.9, 0.95: 0.1}, 4.0 if seed % 2 else None, True)))
    for second in (1, 2):
        frame, = made.encode(image(pixels, encoding, second), of, size)
        assert frame.datagram_size <= size and size_on_air([frame]) <= max(budget, LEAST_BYTES)
        parts = segments([frame])
        shown, _ = received(parts, range(len(parts)))
        assert shown is not None
        assert made.operating_points(5.0, of)


@pytest.mark.parametrize('size, texts, budget', [(500, 200, 600), (256, 80, 100), (1472, 1200, 600), (500, 380, 9999)])
def test_texts_that_fill_most_of_a_datagram(size: int, texts: int, budget: int) -> None:
    of = settings(max_bytes=budget)
    made = encoder(of, BAD)
    for second in range(1, 4):
        message = image(CASES['mono8'] + np.uint8(9 * second), 'mono8')
        message.header.frame_id, message.header.stamp = 'x' * texts, Time.from_sec(1 + 0.1 * second)
        frame, = made.encode(message, of, size)
        parts = segments([frame])
        shown, _ = received(parts, range(len(parts)))
        assert shown is not None and frame.datagram_size <= size and parts[0].header.frame_id == 'x' * texts


def test_a_stream_that_may_use_nothing_of_the_link_sends_the_least() -> None:
    of, scene = settings(rate=10.0), photograph(96, 256, high=2000) + 7000
    made = encoder(of, NO_LOSS._replace(room=0.0))
    for k in range(4):
        message = image(scene[:, 8 * k:][:, :128].astype(np.uint16), 'mono16')
        message.header.stamp = Time.from_sec(1 + 0.1 * k)
        assert size_on_air(made.encode(message, of, DATAGRAM)) <= LEAST_BYTES


@pytest.mark.parametrize('change', ['encoding', 'scale', 'depth_unit'])
def test_images_of_another_kind_are_no_motion(change: str) -> None:
    """The last two are, with other values, as if the whole scene had moved: they are as long as the others."""
    sizes = []
    for changes in (False, True):
        made = encoder(settings(), NO_LOSS._replace(room=60000.0))
        for k in range(6):
            other, pixels = changes and k > 3, photograph(high=2000) + 7000
            of = settings(scale=2 if other and change == 'scale' else 1, rate=10.0,
                          depth_unit=0.95 if other and change == 'depth_unit' else 1.0)
            encoding = '16UC1' if other and change == 'encoding' else 'mono16'
            if other:
                pixels = pixels[:, ::-1]
            if change == 'scale':
                pixels = np.kron(pixels, np.ones((of['scale'], of['scale'])))
            encoding, kind = ('32FC1', np.float32) if change == 'depth_unit' else (encoding, np.uint16)
            message = image(pixels.astype(kind), encoding)
            message.header.stamp = Time.from_sec(1 + 0.1 * k)
            frames = made.encode(message, of, DATAGRAM)
        sizes.append(size_on_air(frames))
    assert sizes[1] == pytest.approx(sizes[0], rel=0.05)


@pytest.mark.parametrize('size', [256, 576, DATAGRAM])
def test_the_smallest_image_and_the_shortest_datagrams(size: int) -> None:
    of = settings()
    frames = encoder(of).encode(image(np.array([[77]], np.uint8), 'mono8'), of, size)
    parts = segments(frames)
    shown, _ = received(parts, range(len(parts)))
    assert shown.pixels.tolist() == [[77]] and all(frame.datagram_size <= size for frame in frames)
    assert all(frame.datagram_size <= size for frame in encoder(of).encode(
        image(CASES['bgr8'], 'bgr8'), of, size))


# operating points

def test_operating_points_are_rates_and_images_take_what_is_left_over_by_themselves() -> None:
    of = settings(rate=20.0)
    made = encoder(of, NO_LOSS._replace(room=20 * 1500))
    frames = made.encode(image(CASES['mono16'], 'mono16'), of, DATAGRAM)
    assert size_on_air(frames) <= 1500
    points = made.operating_points(20.0, of)
    assert points[-1].settings == {'rate': 20.0} and points[-1].cost > 20 * 1500
    late = [point for point in points if point.cost < 9.99 * LEAST_BYTES]
    assert [point.settings['rate'] for point in late] == pytest.approx([point.cost / LEAST_BYTES for point in late])
    in_time = points[len(late)]
    assert in_time.settings == {'rate': pytest.approx(10.0)} and in_time.cost == pytest.approx(10 * LEAST_BYTES)
    assert made.refine(points[0].settings, 2500.0) == points[0].settings
    assert made.operating_points(20.0, settings(max_bytes=2000))[-1].cost == 20 * 2000


def test_the_cost_of_a_complete_image_changes_in_steps() -> None:
    of, costs = settings(), set()
    made = encoder(of)
    for second in range(1, 20):
        noisy = CASES['mono16'] + np.random.RandomState(second).randint(0, 3, (96, 128)).astype(np.uint16)
        made.encode(image(noisy, 'mono16', second), of, DATAGRAM)
        costs.add(made.operating_points(10.0, of)[-1].cost)
    assert len(costs) <= 3


@pytest.mark.parametrize('encoding', CASES)
def test_a_short_image_tells_about_what_an_exact_one_takes(encoding: str) -> None:
    pixels, of = CASES[encoding], settings()
    exact = encoder(of)
    for second in (1, 2, 3):
        parts = segments(exact.encode(image(pixels, encoding, second), of, DATAGRAM))
    shown, _ = received(parts, range(len(parts)))
    assert (shown.pixels == pixels).all()
    for part in (10, 4, 2):
        short = settings(max_bytes=pixels.nbytes // part)
        made = encoder(short)
        made.encode(image(pixels, encoding), short, DATAGRAM)
        assert 0.95 <= made.operating_points(10.0, of)[-1].cost / 10.0 / exact.message_size <= 1.5


# bytes on the wire

def test_golden_bytes() -> None:
    of = settings(max_bytes=600)
    made = encoder(of, session=lambda: 0x04030201)
    frame, = made.encode(image(np.array([[0, 0], [0, 200]], np.uint8), 'mono8'), of, DATAGRAM)
    segment, = segments([frame])
    row = frame.rows[0, OVERHEAD:].tobytes()
    assert row[:4] == b'\0\0\0\0'                                   # seq: the publisher's
    assert row[4:12] == b'\1\0\0\0\7\0\0\0'                         # stamp
    assert row[12:20] == b'\4\0\0\0lens'
    assert row[20:28] == 8 * b'\0'                                  # arrival
    assert row[28:36] == b'\2\0\0\0\2\0\0\0'                        # height, width
    assert row[36:45] == b'\5\0\0\0mono8'
    assert row[45:50] == b'\0' + b'\0\0\0\0'                        # is_bigendian, depth_unit
    assert row[50:54] == b'\0\0\1\0'                                # index, count
    assert row[54:59] == b'\1\0\0\0\1'                              # thresholds
    size = len(segment.data)
    assert row[59:65] == b'\1\0\0\0' + size.to_bytes(2, 'little')   # sizes
    assert row[65:69] == b'\1\0\0\0' and row[69] == segment.errors[0]
    assert row[70:78] == b'\1\2\3\4\0\0\0\0'                      # session, picture
    assert row[78:87] == 9 * b'\0'                                  # reference, reference_layers, checksum
    assert row[87:91] == size.to_bytes(4, 'little') and row[91:] == segment.data
