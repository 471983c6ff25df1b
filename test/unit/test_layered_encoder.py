# SPDX-License-Identifier: BSD-3-Clause
"""The robot's side of layered images, decoded from some of the datagrams by the codec itself."""
import math
from typing import Any, List, Mapping, Optional, Sequence

import needs_numba  # noqa: F401
import numpy as np
import pytest
from genpy import Time
from hypothesis import given
from hypothesis import settings as settings_of_property
from hypothesis import strategies as st
from sensor_msgs.msg import Image

from smokebot_udp.codecs.layered import depth, quality
from smokebot_udp.codecs.layered.image import Decoded, decode
from smokebot_udp.codecs.layered.pieces import Layer, Restorer
from smokebot_udp.mission.parameters import check
from smokebot_udp.mission.settings import Settings
from smokebot_udp.msg import ImageSegment, LayeredSegment
from smokebot_udp.streams.air import Air
from smokebot_udp.streams.image.encoder import ImageEncoder
from smokebot_udp.streams.image.layered_encoder import LEAST_BYTES
from smokebot_udp.streams.outlook import Outlook
from smokebot_udp.streams.segments import size_on_air
from smokebot_udp.udpros.datagram import OVERHEAD

DATAGRAM = 1472
NO_LOSS = Outlook(Air({0.0: 1.0}, None, True))
BAD = Outlook(Air({0.0: 0.2, 0.2: 0.5, 0.5: 0.3}, None, True))


def photograph(height: int = 96, width: int = 128, channels: int = 1, high: float = 255.0) -> Any:
    """Smooth, with an edge and some noise: (height, width[, channels]) float."""
    rows, columns = np.mgrid[:height, :width]
    parts = [0.5 + 0.3 * np.sin(rows / 17 + k) * np.cos(columns / 23) - 0.2 * (columns > 60 + 5 * k)
             + 0.004 * np.random.RandomState(k).randn(height, width) for k in range(channels)]
    return high * np.clip(np.dstack(parts) if channels > 1 else parts[0], 0, 1)


def image(pixels: Any, encoding: str, seconds: int = 1, big: bool = False) -> Any:
    pixels = np.ascontiguousarray(pixels)
    message = Image(height=pixels.shape[0], width=pixels.shape[1], encoding=encoding, step=pixels.strides[0],
                    data=pixels.tobytes(), is_bigendian=big)
    message.header.stamp, message.header.frame_id = Time(seconds, 7), 'lens'
    return message


def settings(granted: Optional[Mapping[str, Any]] = None, **changes: Any) -> Settings:
    return Settings(check({'robot_topic': '/in', 'coding': 'layered', **changes}, ImageEncoder.PARAMETERS),
                    granted or {})


def encoder(of: Settings, outlook: Outlook = NO_LOSS, **options: Any) -> ImageEncoder:
    made = ImageEncoder(of.requested, **options)
    made.outlook = outlook
    return made


def segments(frames: Sequence[Any]) -> List[Any]:
    return [frame.message_class().deserialize(row[OVERHEAD:].tobytes()) for frame in frames for row in frame.rows]


def received(parts: Sequence[Any], arrived: Sequence[int]) -> Any:
    """(Decoded, error byte of the layers) of some segments of an image."""
    first = parts[0]
    restorer = Restorer(first.count, [Layer(*layer) for layer in zip(first.thresholds, first.sizes)])
    assert restorer.add(np.array([parts[i].index for i in arrived]),
                        np.array([list(parts[i].data) for i in arrived], np.uint8)).all()
    colours = first.encoding in ('bgr8', 'rgb8', '8UC3')
    wide = first.encoding in ('mono16', '16UC1', '32FC1')
    decoded = decode(restorer.restored(), first.height, first.width, 3 if colours else 1, 2 if wide else 1)
    return decoded, first.errors[restorer.restorable - 1] if restorer.restorable else None


def rms(decoded: Decoded, pixels: Any) -> float:
    return float(np.sqrt(((decoded.pixels.astype(float) - pixels) ** 2).mean()))


CASES = {
    'mono8': photograph().astype(np.uint8), 'mono16': (7000 + photograph(high=2000)).astype(np.uint16),
    'bgr8': photograph(channels=3).astype(np.uint8),
}


@pytest.mark.parametrize('encoding', CASES)
def test_a_tenth_of_the_bytes_shows_the_image_though_datagrams_are_lost(encoding: str) -> None:
    pixels, of = CASES[encoding], settings({'max_bytes': 6000})
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


def test_a_fast_link_without_loss_shows_the_exact_image_from_the_second_one_on() -> None:
    """How long a complete stream is follows from the image before."""
    pixels, of = CASES['mono16'], settings()
    made = encoder(of)
    for second in (1, 2, 3):
        parts = segments(made.encode(image(pixels, 'mono16', second), of, DATAGRAM))
        shown, error = received(parts, range(len(parts)))
    assert (shown.pixels == pixels).all() and error == quality.EXACT
    assert made.message_size < 0.6 * pixels.nbytes


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
    assert sizes[0] > 4500 and 0.55 * sizes[0] <= sizes[8] < 0.9 * sizes[0]


@settings_of_property(max_examples=60)
@given(st.sampled_from(['mono8', 'mono16', 'bgr8', '32FC1']), st.integers(1, 40), st.integers(1, 40),
       st.integers(1, 20000), st.integers(256, DATAGRAM), st.sampled_from([0.0, 0.3, 0.9]), st.integers(0, 9))
def test_any_image_at_any_budget(encoding: str, height: int, width: int, budget: int, size: int, loss: float,
                                 seed: int) -> None:
    random = np.random.RandomState(seed)
    pixels = random.randint(0, 256 if seed else 1, (height, width, 3)).astype(np.uint8)
    if encoding != 'bgr8':
        pixels = pixels[..., 0].astype({'mono8': np.uint8, 'mono16': np.uint16, '32FC1': np.float32}[encoding])
    if encoding == '32FC1':
        pixels[pixels < 64] = np.nan
    of = settings({'max_bytes': budget}, depth_unit=0.01)
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
    of = settings({'max_bytes': budget})
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


# encodings

@pytest.mark.parametrize('encoding, sent', [
    ('bgr8', 'bgr8'), ('rgb8', 'rgb8'), ('8UC3', '8UC3'), ('bgra8', 'bgr8'), ('rgba8', 'rgb8')])
def test_colours_are_coded_as_blue_green_red(encoding: str, sent: str) -> None:
    pixels = CASES['bgr8']
    message = pixels[..., ::-1] if encoding.startswith('rgb') else pixels
    if encoding.endswith('a8'):
        message = np.dstack([message, np.full(pixels.shape[:2], 255, np.uint8)])
    of = settings()
    parts = segments(encoder(of).encode(image(message, encoding), of, DATAGRAM))
    shown, _ = received(parts, range(len(parts)))
    assert parts[0].encoding == sent and rms(shown, pixels) < 1.0


@pytest.mark.parametrize('encoding', ['mono16', '16UC1'])
def test_the_byte_order_of_the_source_is_kept_in_the_message_and_not_in_the_pixels(encoding: str) -> None:
    pixels, of = CASES['mono16'], settings()
    parts = segments(encoder(of).encode(image(pixels.astype('>u2'), encoding, big=True), of, DATAGRAM))
    shown, _ = received(parts, range(len(parts)))
    assert parts[0].is_bigendian == 1 and rms(shown, pixels) < 2.0


def test_depth_is_coded_in_counts_and_what_is_no_number_stays() -> None:
    metres = (1.0 + photograph(high=3.0)).astype(np.float32)
    metres[:10], metres[10:15, :20], metres[-1] = np.nan, np.inf, -np.inf
    of = settings(depth_unit=0.001)
    made = encoder(of)
    for second in (1, 2, 3):
        parts = segments(made.encode(image(metres, '32FC1', second), of, DATAGRAM))
        decoded, error = received(parts, range(len(parts)))
    assert parts[0].encoding == '32FC1' and parts[0].depth_unit == pytest.approx(0.001)
    shown = depth.from_counts(decoded, parts[0].depth_unit)
    finite = np.isfinite(metres)
    assert error == quality.EXACT and np.abs(shown[finite] - metres[finite]).max() <= 0.00051
    assert (np.isnan(shown) == np.isnan(metres)).all() and (shown == np.inf).sum() == 100
    assert (shown[-1] == -np.inf).all()


def test_depth_with_scattered_holes_is_shown_on_a_slow_link() -> None:
    random = np.random.RandomState(1)
    metres = (1.0 + photograph(480, 640, high=3.0)).astype(np.float32)
    metres[random.random_sample(metres.shape) < 0.05] = np.nan
    finite = np.isfinite(metres)
    of = settings(depth_unit=0.001, rate=10.0)
    made = encoder(of, BAD._replace(room=62500.0))
    for second in (1, 2):
        parts = segments(made.encode(image(metres, '32FC1', second), of, DATAGRAM))
        decoded, error = received(parts, range(len(parts)))
        assert decoded is not None and error != quality.EXACT
        difference = (depth.from_counts(decoded, 0.001) - metres)[finite & (decoded.classes == 0)] / 0.001
        assert len(difference) > 0.9 * finite.sum()
        assert quality.from_byte(error) == pytest.approx(float(np.sqrt((difference ** 2).mean())), rel=0.5)
    # where there is room for the whole map it comes, and stays
    made.outlook = NO_LOSS
    for second in range(3, 8):
        parts = segments(made.encode(image(metres, '32FC1', second), of, DATAGRAM))
        decoded, error = received(parts, range(len(parts)))
        if second > 4:
            assert error == quality.EXACT and (np.isfinite(depth.from_counts(decoded, 0.001)) == finite).all()


def test_a_reduced_image_is_coded_reduced() -> None:
    pixels, of = CASES['bgr8'], settings(scale=2)
    parts = segments(encoder(of).encode(image(pixels, 'bgr8'), of, DATAGRAM))
    shown, _ = received(parts, range(len(parts)))
    mean = pixels.reshape(48, 2, 64, 2, 3).mean(axis=(1, 3))
    assert (parts[0].height, parts[0].width) == (48, 64) and rms(shown, mean) < 1.0


@pytest.mark.parametrize('encoding, item, fault', [
    ('8UC4', (4, np.uint8), r"coding is layered, but encoding is '8UC4', which cannot be layered; mono8, .*rgba8 can"),
    ('32FC1', (1, np.float32), "encoding is '32FC1', which can be layered only if depth_unit is set"),
    ('bayer_rggb8', (1, np.uint8), "encoding is 'bayer_rggb8', which cannot be layered"),
])
def test_what_cannot_be_layered_is_refused_and_auto_interleaves_it(encoding: str, item: Any, fault: str) -> None:
    message = image(np.ones((8, 8) + (item[0],) * (item[0] > 1), item[1]), encoding)
    with pytest.raises(ValueError, match=fault):
        encoder(settings()).encode(message, settings(), DATAGRAM)
    auto = settings(coding='auto')
    if encoding.startswith('bayer'):
        with pytest.raises(ValueError, match='encoding'):       # not interleaved either
            encoder(auto).encode(message, auto, DATAGRAM)
    else:
        frame, = encoder(auto).encode(message, auto, DATAGRAM)
        assert frame.message_class is ImageSegment


def test_an_image_above_the_limit_is_refused() -> None:
    with pytest.raises(ValueError, match='coding is layered, but 1500 x 1000 pixels bgr8 are 4500000 values'):
        encoder(settings()).encode(image(np.zeros((1500, 1000, 3), np.uint8), 'bgr8'), settings(), DATAGRAM)
    auto = settings(coding='auto')
    frames = encoder(auto, BAD).encode(image(np.zeros((1500, 1000, 3), np.uint8), 'bgr8'), auto, DATAGRAM)
    assert {frame.message_class for frame in frames} == {ImageSegment}
    halved = settings(scale=2)
    frame, = encoder(halved).encode(image(np.zeros((1500, 1000, 3), np.uint8), 'bgr8'), halved, DATAGRAM)
    assert frame.message_class is LayeredSegment


def test_a_wrong_message_is_named() -> None:
    message = image(CASES['mono8'], 'mono8')
    message.step = 5
    with pytest.raises(ValueError, match='step is 5'):
        encoder(settings()).encode(message, settings(), DATAGRAM)


# which coding

class Loading:
    """A codec that is not there at first."""
    loaded = False

    def ready(self) -> bool:
        return self.loaded


def kind(made: ImageEncoder, of: Settings, second: int) -> Any:
    frames = made.encode(image(CASES['mono16'], 'mono16', second), of, DATAGRAM)
    kinds = {frame.message_class for frame in frames}
    assert len(kinds) == 1
    return kinds.pop()


@pytest.mark.parametrize('coding', ['layered', 'auto'])
def test_images_cross_interleaved_until_the_codec_is_loaded_and_every_operator_receives_layers(coding: str) -> None:
    of, codec = settings(coding=coding), Loading()
    made = encoder(of, NO_LOSS._replace(room=1e4), codec=codec)
    assert made.parts(of) == ['segments', 'layers'] and made.parts(settings(coding='interleaved')) == ['segments']
    assert kind(made, of, 1) is ImageSegment
    codec.loaded, made.heard = True, lambda part: part == 'segments'
    assert kind(made, of, 2) is ImageSegment
    made.heard = lambda part: True
    assert kind(made, of, 3) is LayeredSegment


def test_the_coding_changes_while_it_runs_and_so_do_the_operating_points() -> None:
    made = encoder(settings())
    assert made.operating_points(10.0, settings()) == []
    for second, coding in enumerate(['interleaved', 'layered', 'interleaved', 'layered'], 1):
        of = settings(coding=coding)
        used = kind(made, of, second)
        assert used is (LayeredSegment if coding == 'layered' else ImageSegment)
        point = made.operating_points(10.0, of)[0]
        assert set(point.settings) == {'max_bytes' if coding == 'layered' else 'max_subimages', 'rate'}
        assert made.refine(point.settings, 1e9) == {'rate': point.settings['rate']}


def test_auto_is_interleaved_where_raw_pixels_fit_and_layered_where_they_do_not_or_are_lost() -> None:
    of = settings(coding='auto', rate=10.0)
    for outlook, expected in ((NO_LOSS, ImageSegment), (NO_LOSS._replace(room=1e5), LayeredSegment),
                              (BAD, LayeredSegment), (Outlook(), LayeredSegment)):
        assert kind(encoder(of, outlook), of, 1) is expected


def test_auto_goes_by_the_images_that_the_source_has() -> None:
    of = settings(coding='auto', rate=30.0)
    made = encoder(of, NO_LOSS._replace(room=3e5))      # raw images take 27 kB
    assert kind(made, of, 1) is LayeredSegment
    slow = encoder(of, NO_LOSS._replace(room=3e5))
    slow.source_rate = 5.0
    assert kind(slow, of, 1) is ImageSegment


def test_auto_gives_up_layers_on_a_processor_that_is_too_slow() -> None:
    now = iter(np.arange(0.0, 1e3, 0.04))       # at each look at the clock it is 40 ms later
    of = settings(coding='auto', rate=30.0)
    made = encoder(of, BAD, clock=lambda: float(next(now)))
    kinds = [kind(made, of, second) for second in range(1, 12)]
    assert kinds[0] is LayeredSegment and kinds[-1] is ImageSegment


def test_auto_goes_by_the_time_between_the_images_that_the_source_has() -> None:
    now = iter(np.arange(0.0, 1e3, 0.04))
    of = settings(coding='auto', rate=30.0)
    made = encoder(of, BAD, clock=lambda: float(next(now)))
    made.source_rate = 10.0     # 40 ms are not too slow
    assert [kind(made, of, second) for second in range(1, 12)] == 11 * [LayeredSegment]


def test_auto_interleaves_no_images_above_max_bytes() -> None:
    for most, expected in ((2000, LayeredSegment), (100000, ImageSegment)):     # raw images take 27 kB
        of = settings(coding='auto', rate=10.0, max_bytes=most)
        assert kind(encoder(of, NO_LOSS), of, 1) is expected


# operating points

def test_operating_points_are_bytes_and_rate_and_what_is_left_over_makes_more_bytes() -> None:
    of = settings({'max_bytes': 1500}, rate=8.0)
    made = encoder(of)
    frames = made.encode(image(CASES['mono16'], 'mono16'), of, DATAGRAM)
    assert size_on_air(frames) <= 1500
    points = made.operating_points(8.0, of)
    assert points[-1].settings == {'max_bytes': 0, 'rate': 8.0} and points[-1].cost > 8 * 1500
    assert points[0].settings['max_bytes'] == 600
    assert made.refine(points[0].settings, 8.0 * 250) == {**points[0].settings, 'max_bytes': 850}
    assert made.refine(points[-1].settings, 0.0) == {'rate': 8.0}
    limited = settings(max_bytes=2000, rate=8.0)
    assert made.operating_points(8.0, limited)[-1].cost == 8 * 2000


def test_the_cost_of_a_complete_image_changes_in_steps() -> None:
    of, costs = settings(), set()
    made = encoder(of)
    for second in range(1, 20):
        noisy = CASES['mono16'] + np.random.RandomState(second).randint(0, 3, (96, 128)).astype(np.uint16)
        made.encode(image(noisy, 'mono16', second), of, DATAGRAM)
        costs.add(made.operating_points(10.0, of)[-1].cost)
    assert len(costs) <= 3


# bytes on the wire

def test_golden_bytes() -> None:
    of = settings({'max_bytes': 600})
    frame, = encoder(of).encode(image(np.array([[0, 0], [0, 200]], np.uint8), 'mono8'), of, DATAGRAM)
    segment, = segments([frame])
    row = frame.rows[0, OVERHEAD:].tobytes()
    assert row[:4] == b'\0\0\0\0'                                   # seq: the publisher's
    assert row[4:12] == b'\1\0\0\0\7\0\0\0'                         # stamp
    assert row[12:20] == b'\4\0\0\0lens'
    assert row[20:28] == b'\2\0\0\0\2\0\0\0'                        # height, width
    assert row[28:37] == b'\5\0\0\0mono8'
    assert row[37:42] == b'\0' + b'\0\0\0\0'                        # is_bigendian, depth_unit
    assert row[42:46] == b'\0\0\1\0'                                # index, count
    assert row[46:51] == b'\1\0\0\0\1'                              # thresholds
    size = len(segment.data)
    assert row[51:57] == b'\1\0\0\0' + size.to_bytes(2, 'little')   # sizes
    assert row[57:61] == b'\1\0\0\0' and row[61] == segment.errors[0]
    assert row[62:66] == size.to_bytes(4, 'little') and row[66:] == segment.data
