# SPDX-License-Identifier: BSD-3-Clause
"""What the experiment `video` consists of: clips, the link, H.264 as others send it, and how results are judged."""
import pathlib
from typing import Any, Callable, List, Optional, Sequence

import numpy as np
import pytest

for library in ('cv2', 'matplotlib', 'skimage', 'tqdm'):
    pytest.importorskip(library)

from evaluation import video_clips, video_link, video_peers  # noqa: E402
from evaluation.losses import failing  # noqa: E402
from evaluation.quality import psnr  # noqa: E402
from evaluation.video_jpeg import Jpegs, JpegVideo  # noqa: E402
from evaluation.video_link import SETTLED, Way, constant, watch  # noqa: E402
from evaluation.video_ways import H264, KNOWN, LAYERED, PEERS, PREDICTED, SLICES, Ways  # noqa: E402
from experiments import table  # noqa: E402
from experiments.offline import video_prediction, video_results  # noqa: E402
from experiments.offline.video_results import LINKS  # noqa: E402
from smokebot_udp.arrays import Array, BoolArray  # noqa: E402
from smokebot_udp.link_lab.channel import LinkConditions  # noqa: E402
from smokebot_udp.streams.air import UNKNOWN, Air  # noqa: E402

RATE = 1e6


class Raw(Way):
    """Sends an image in `count` packets; shows it where all come."""

    def __init__(self, count: int = 4) -> None:
        self.airs: List[Air] = []
        self._count = count

    def send(self, image: Array, number: int, air: Air) -> Sequence[int]:
        self._image = image
        self.airs.append(air)
        return [1000] * self._count

    def receive(self, arrived: BoolArray) -> Optional[Array]:
        return self._image if arrived.all() else None


def moving(count: int, shape: Any = (64, 96)) -> List[Array]:
    """Smooth images, each a pixel further than the last one."""
    rows, columns = np.mgrid[:shape[0], :shape[1]]
    return [(128 + 60 * np.sin(rows / 9) + 50 * np.cos((columns + number) / 7)).astype(np.uint8)
            for number in range(count)]


@pytest.fixture
def pyav() -> Any:
    return pytest.importorskip('av')


def test_the_simulated_clip_is_always_the_same_and_moves() -> None:
    one, other = video_clips.swaying(4), video_clips.swaying(5)
    assert one[0].shape == (video_clips.HEIGHT, video_clips.WIDTH, 3) and one[0].dtype == np.uint8
    assert all((a == b).all() for a, b in zip(one, other))
    assert 15 < psnr(one[0], one[3]) < 35


def test_short_recordings_go_backwards_and_forwards_again() -> None:
    if 'euroc' not in video_clips.clips(1):
        pytest.skip('there are no recordings beside the checkout')
    clip = video_clips.clips(61)['euroc']
    assert clip[0].shape == (480, 752) and len(clip) == 61
    assert clip[29 + 7] is clip[29 - 7] and clip[58 + 2] is clip[2] and clip[1] is not clip[2]


def test_the_screen_keeps_the_last_image_and_is_compared_with_the_present() -> None:
    clip = moving(SETTLED + 20)
    perfect = watch(clip, Raw(), constant(LinkConditions()), 1, RATE)
    assert perfect.mean == 60 and perfect.visible == 1 and perfect.freeze == 0
    assert perfect.rate == pytest.approx(4 * 1000 * 8 * video_clips.RATE)
    nothing = watch(clip, Raw(), constant(LinkConditions(loss=1)), 1, RATE)
    assert (nothing.screens[-1] == 128).all() and nothing.freeze == 2.0 and nothing.visible == 0
    half = watch(clip, Raw(1), constant(LinkConditions(loss=0.5)), 1, RATE)
    last = 0
    for number, new in enumerate(half.new):
        last = number if new else last
        if half.new[:number + 1].any():
            assert half.psnr[number] == pytest.approx(psnr(clip[number], clip[last]))
    assert 0 < half.freeze < 2 and half.new.any() and not half.new.all()


def test_reports_come_late() -> None:
    way = Raw(50)
    watch(moving(SETTLED + 10), way, lambda now: LinkConditions(loss=0.5 if now >= 0.95 else 0), 1, RATE)
    losses = [air.loss for air in way.airs]
    assert all(air.known for air in way.airs) and max(losses[:12]) < 0.05      # until 1.15 s nothing is known of it
    assert losses[12] > 0.1 and 0.4 < losses[-1] < 0.7


def test_how_often_a_code_fails() -> None:
    assert failing(LinkConditions(loss=0.5), 2, 3) == pytest.approx(0.5)
    assert failing(LinkConditions(loss=0.25), 1, 2) == pytest.approx(0.0625)
    assert failing(LinkConditions(), 3, 3) == 0 and failing(LinkConditions(loss=1), 1, 9) == 1
    # a bad channel stays bad with 0.8: both of two are lost with 0.3 * 0.8
    assert failing(LinkConditions(loss=0.3, burst=5), 1, 2) == pytest.approx(0.24)


def test_the_code_for_a_known_loss_is_the_least_that_fails_rarely_enough() -> None:
    parities = video_peers.matched(LinkConditions(loss=0.2), 0.03)
    count = parities(6)
    assert failing(LinkConditions(loss=0.2), 6, 6 + count) <= 0.03 < failing(LinkConditions(loss=0.2), 6, 5 + count)
    assert video_peers.matched(LinkConditions(), 0.03)(6) == 0 and video_peers.redundancy(0.25)(5) == 2


def coded(pyav: Any, clip: List[Array], parities: Callable[[int], int] = lambda count: 0) -> video_peers.Video:
    coding = video_peers.sliced(10)
    return video_peers.Video(video_peers.encode(clip, coding, 2e6), coding, clip[0].shape, parities)


def test_slices_are_decoded_and_their_code_restores_them(pyav: Any) -> None:
    clip = [image.repeat(4, 0).repeat(4, 1) + np.random.RandomState(1).randint(0, 40, (256, 384)).astype(np.uint8)
            for image in moving(3)]
    ways = coded(pyav, clip), coded(pyav, clip, lambda count: 1)
    for number, image in enumerate(clip):
        counts = [len(way.send(image, number, UNKNOWN)) for way in ways]
        assert counts[1] == counts[0] + 1 > 3
        arrived = [np.arange(count) != 1 for count in counts]
        lossy, restored = (way.receive(which) for way, which in zip(ways, arrived))
        assert psnr(image, lossy) + 3 < psnr(image, restored) > 30
    assert ways[0].receive(np.zeros(counts[0], bool)) is None


@pytest.mark.parametrize('refresh', (10, 1))
def test_what_is_missing_is_the_image_before_where_images_are_predicted(pyav: Any, refresh: int) -> None:
    clip = [image.repeat(4, 0).repeat(4, 1) for image in moving(2)]
    clip[1] = clip[1].copy()
    clip[1][128:] = np.linspace(20, 230, 384)       # a ramp is best predicted from its own image
    coding = video_peers.sliced(refresh)
    way = video_peers.Video(video_peers.encode(clip, coding, 2e6), coding, clip[0].shape)
    before = way.receive(np.ones(len(way.send(clip[0], 0, UNKNOWN)), bool))
    count = len(way.send(clip[1], 1, UNKNOWN))
    after = way.receive(np.arange(count) == count - 1)
    assert before is not None and after is not None
    assert np.array_equal(before[:64], after[:64]) == (refresh > 1)


def test_what_is_lost_with_any_packet(pyav: Any) -> None:
    clip = moving(2, (256, 384))
    coding = video_peers.NIMBRO_NETWORK
    way = video_peers.Video(video_peers.encode(clip, coding, 2e6), coding, clip[0].shape, mended=False)
    arrived = np.ones(len(way.send(clip[0], 0, UNKNOWN)), bool)
    assert psnr(clip[0], way.receive(arrived)) > 30
    arrived = np.ones(len(way.send(clip[1], 1, UNKNOWN)), bool)
    arrived[-1] = False
    assert way.receive(arrived) is None


def test_colours_survive(pyav: Any) -> None:
    clip = video_clips.swaying(2)
    way = coded(pyav, clip)
    sizes = way.send(clip[0], 0, UNKNOWN)
    assert psnr(clip[0], way.receive(np.ones(len(sizes), bool))) > 30


def test_the_bit_rate_leaves_room_for_heads_and_redundancy(pyav: Any) -> None:
    clip = video_clips.swaying(SETTLED + 15)
    encodings, coding, rate = video_peers.Encodings(clip), video_peers.sliced(10), 6e5
    for parities in (video_peers.redundancy(0.0), video_peers.redundancy(1.0)):
        way = video_peers.Video(encodings.fitted(coding, rate, parities), coding, clip[0].shape, parities)
        assert 0.85 * rate < watch(clip, way, constant(LinkConditions()), 1, rate).rate <= rate


def test_who_knows_the_loss_is_better_where_there_is_some(pyav: Any) -> None:
    ways, conditions = Ways(video_clips.swaying(SETTLED + 30), quick=True), LinkConditions(loss=0.3)
    found = [watch(ways.clip, ways.make(way, RATE, conditions, 1), constant(conditions), 1, RATE).mean
             for way in (SLICES, KNOWN)]
    assert found[0] + 1 < found[1]


def test_a_jpeg_leaves_room_for_its_code() -> None:
    clip, conditions = moving(video_link.SETTLED + 2, (240, 320)), LinkConditions(loss=0.2)
    jpegs = Jpegs(clip)
    way = JpegVideo(jpegs, jpegs.code(4e5, conditions))
    sizes = way.send(clip[3], 3, UNKNOWN)
    assert sum(sizes) <= 4e5 / 8 / video_clips.RATE
    assert psnr(clip[3], way.receive(np.ones(len(sizes), bool))) > 30
    assert way.receive(np.zeros(len(sizes), bool)) is None


def row(way: str, link: str, value: float, freeze: float = 0.0, clip: str = 'corridor') -> table.Row:
    return {'clip': clip, 'Mbit/s': 1.0, 'link': link, 'way': way, 'PSNR [dB]': value, 'visible [%]': 100,
            'freeze [s]': freeze, 'used [Mbit/s]': 1.0, 'encode [ms]': 5.0, 'decode [ms]': 2.0}


def test_ours_must_be_as_good_as_the_best_peer_but_for_a_decibel(tmp_path: pathlib.Path) -> None:
    rows = [row(way, link, 40.0 + (way == KNOWN)) for way in PEERS for link in LINKS]
    table.write(tmp_path / 'video.csv', rows + [row(H264, link, 40.1) for link in LINKS])
    assert video_results.missed(tmp_path) == []
    table.write(tmp_path / 'video.csv', rows + [row(H264, link, 39.9, 0.6) for link in list(LINKS)[3:]])
    assert video_results.missed(tmp_path) == [
        'corridor, 1 Mbit/s, 50 %: 39.9 dB, H.264 slices, loss known: 41.0 dB',
        'corridor, 1 Mbit/s, 30 %, bursts of 5: 39.9 dB, H.264 slices, loss known: 41.0 dB',
        'corridor, 1 Mbit/s, 50 %: a freeze of 0.6 s']


def test_the_quality_after_a_step_is_compared_with_the_steady_one(tmp_path: pathlib.Path) -> None:
    times = np.arange(150) / 10
    curves = {'2 %': 41 + 0 * times, '30 %': 38 + 0 * times,
              'steps': np.where((times >= 5) & (times < 10), np.where(times < 5.6, 30, 38), 41)}
    rows = [{'clip': 'euroc', 'way': H264, 'link': link, 'time [s]': time, 'PSNR [dB]': float(value)}
            for link, values in curves.items() for time, value in zip(times.tolist(), values)]
    assert video_results.gaps(rows, 'euroc', H264) == [pytest.approx(8 / 5), 0]
    table.write(tmp_path / 'steps.csv', rows)
    assert list(video_results.slow_steps(tmp_path)) == []


def test_what_prediction_must_gain(tmp_path: pathlib.Path) -> None:
    assert video_prediction.tables(tmp_path) == [] and video_prediction.missed(tmp_path) == []
    rows = [{'clip': clip, 'kB': size, 'loss': loss, 'way': way, 'PSNR [dB]': value, 'exact from [s]': since,
             'encode [ms]': 20.0, 'decode [ms]': 20.0}
            for clip, size, loss, way, value, since in (
                ('euroc, small', 5.0, 0.0, PREDICTED, 32.9, None), ('euroc, small', 5.0, 0.0, LAYERED, 30.0, None),
                ('thermal, standing', 12.5, 0.2, PREDICTED, 60.0, 6.0),
                ('thermal, standing', 12.5, 0.2, LAYERED, 40.0, None))]
    table.write(tmp_path / video_prediction.FILE, rows)
    assert video_prediction.missed(tmp_path) == [
        'thermal, standing, 12.5 kB, 20 %: exact from 6 s on', 'euroc, small, 5 kB, 0 %: prediction gains 2.90 dB']
    found, = video_prediction.tables(tmp_path)
    assert [of_case[:7] for of_case in found.rows] == [
        ['thermal, standing', 12.5, '20 %', '40.0', '60.0', '+20.00', 6],
        ['euroc, small', 5, '0 %', '30.0', '32.9', '+2.90', None]]


def test_from_when_on_an_image_is_exact() -> None:
    clip = moving(SETTLED + 5)
    perfect = watch(clip, Raw(), constant(LinkConditions()), 1, RATE)
    assert video_prediction.exact_from(clip, perfect) == 0.0
    wrong = perfect._replace(screens=clip[:2] + [clip[0]] + clip[3:])
    assert video_prediction.exact_from(clip, wrong) == pytest.approx(0.3)
    assert video_prediction.exact_from(clip, perfect._replace(screens=clip[:-1] + [clip[0]])) is None
