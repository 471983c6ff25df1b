# SPDX-License-Identifier: BSD-3-Clause
"""What the experiments without a network consist of."""
import re
from typing import List

import numpy as np
import pytest

for library in ('cv2', 'matplotlib', 'skimage', 'tqdm'):
    pytest.importorskip(library)

import cv2  # noqa: E402
from nav_msgs.msg import OccupancyGrid  # noqa: E402

from evaluation import TOP, jpeg_packets, offline_link, quality  # noqa: E402
from evaluation.display import GREY, HEIGHT, WIDTH, Display  # noqa: E402
from evaluation.quality import MAX_PSNR  # noqa: E402
from experiments import doc_images  # noqa: E402
from experiments.offline import cloud_loss, image_quality, map_reduction  # noqa: E402
from smokebot_udp.arrays import UInt8Array  # noqa: E402
from smokebot_udp.codecs.wire.grid import UNKNOWN  # noqa: E402
from smokebot_udp.link_lab.channel import Channel, LinkConditions  # noqa: E402
from smokebot_udp.udpros.frame import Frame  # noqa: E402

IMAGE = np.random.RandomState(1).randint(0, 256, (240, 320)).astype(np.uint8)


def image_frames(image: UInt8Array) -> List[Frame]:
    return offline_link.Sender('image', coding='interleaved').frames(offline_link.image_message(image))


@pytest.mark.parametrize('fill', offline_link.FILLS)
def test_a_whole_image_arrives_as_it_was_sent_and_none_without_datagrams(fill: str) -> None:
    receiver, frames = offline_link.image_receiver(fill), image_frames(IMAGE)
    arrived = np.ones(offline_link.datagram_count(frames), bool)
    assert (offline_link.image_of(offline_link.received(receiver, frames, arrived)) == IMAGE).all()
    arrived[1::2] = False
    half = offline_link.image_of(offline_link.received(receiver, frames, arrived))
    assert 0.5 < (half == IMAGE).mean() < 0.6      # some are filled with their own value
    assert offline_link.received(receiver, frames, ~np.ones_like(arrived)) is None


def test_segments_are_in_sending_order_across_frames() -> None:
    frames = image_frames(IMAGE[:200, :300])
    assert len(frames) > 1      # the last segment is shorter
    arrived = np.zeros(offline_link.datagram_count(frames), bool)
    arrived[[0, 2, -1]] = True
    first, last = offline_link.records_of(frames, arrived)
    assert first['index'].tolist() == frames[0].records['index'][[0, 2]].tolist()
    assert last['index'].tolist() == [frames[-1].records['index'][-1]]


def test_a_layered_image_needs_enough_of_its_datagrams() -> None:
    frames = offline_link.Sender('image', coding='layered').frames(offline_link.image_message(IMAGE // 16))
    receiver, arrived = offline_link.image_receiver('nearest'), np.ones(offline_link.datagram_count(frames), bool)
    assert receiver.part_of(frames[0]) == 'layers'
    whole = offline_link.image_of(offline_link.received(receiver, frames, arrived))
    assert quality.psnr(IMAGE // 16, whole) > 45
    arrived[1:] = False
    assert offline_link.received(receiver, frames, arrived) is None


@pytest.mark.parametrize('loss, shown', [(0.0, [True] * 3), (1.0, [False] * 3)])
def test_layered_images_within_a_budget(loss: float, shown: List[bool]) -> None:
    smooth = cv2.GaussianBlur(IMAGE, (0, 0), 4)
    images = list(image_quality.layered_shown(9000, [smooth] * 3, Channel(LinkConditions(loss=loss), 1)))
    assert [image is not None for image in images] == shown
    assert all(quality.psnr(smooth, image) > 40 for image in images if image is not None)


def test_refresh_cycles_of_a_map_complete_each_other() -> None:
    cells = np.random.RandomState(2).choice(np.array([0, 100], np.int8), (60, 80))
    message = OccupancyGrid(data=cells.ravel())
    message.info.height, message.info.width, message.info.resolution = 60, 80, 0.05
    frames = offline_link.Sender('grid', coding='interleaved').frames(message)
    receiver = offline_link.Receiver('grid', fill='unknown')
    odd = np.arange(offline_link.datagram_count(frames)) % 2 == 1
    first = map_reduction.cells_of(receiver.update(offline_link.records_of(frames, odd)))
    assert 0.3 < (first == UNKNOWN).mean() < 0.7
    assert (first == cells)[first != UNKNOWN].all()
    assert (map_reduction.cells_of(receiver.update(offline_link.records_of(frames, ~odd))) == cells).all()


def test_erasure_codes() -> None:
    code = jpeg_packets.ErasureCode(2, 3, 1500)
    assert code.success(LinkConditions(loss=0.5)) == pytest.approx(0.5)        # 2 or 3 of 3: (3 + 1) / 8
    assert code.room == 2 * (1500 - 28 - 8) - jpeg_packets.MESSAGE_OVERHEAD
    assert [code.data for code in jpeg_packets.codes(4500)] == [1, 2, 3]
    assert {code.size * code.packets for code in jpeg_packets.codes(4000)} == {4000}
    assert jpeg_packets.with_redundancy(56 * 1500, 0.25)[:2] == (44, 56)       # 45 would need 56.25


def test_the_code_that_knows_the_loss_adds_none_without_and_much_with_it() -> None:
    ladder = jpeg_packets.JpegLadder(cv2.GaussianBlur(IMAGE, (0, 0), 2))
    assert jpeg_packets.for_loss(12 * 1500, LinkConditions(), [ladder])[:2] == (12, 12)
    assert 1 < jpeg_packets.for_loss(12 * 1500, LinkConditions(loss=0.5), [ladder]).data < 6


def test_the_best_jpeg_is_the_best_that_fits() -> None:
    ladder = jpeg_packets.JpegLadder(IMAGE)
    assert ladder.best(10) is None and ladder.decoded(10) is None
    rooms = 3000, 10000, 100000
    steps = [ladder.best(room) for room in rooms]
    assert all(step.size <= room for step, room in zip(steps, rooms))
    assert steps[0].psnr < steps[1].psnr < steps[2].psnr
    assert steps[0].scale > 1 and steps[2].scale == 1      # noise is too much for few bytes
    assert ladder.decoded(100000).shape == IMAGE.shape


def test_the_last_image_stays_and_is_compared_with_the_present() -> None:
    display, black, white = Display(), *(np.full((HEIGHT, WIDTH), value, np.uint8) for value in (0, 255))
    display.show(None, white)
    assert (display.shown[-1] == GREY).all()
    display.show(black, black)
    display.show(None, white)
    display.show(None, black)
    row = display.row()
    assert row['new pictures [%]'] == 25 and row['SSIM'] == 1.0
    grey = 20 * np.log10(255 / (255 - GREY))
    image, psnr, new = display.typical()
    assert (image == black).all() and psnr == MAX_PSNR and new
    assert row['PSNR [dB]'] == pytest.approx((grey + MAX_PSNR + 0 + MAX_PSNR) / 4, abs=1e-3)


def test_what_is_kept_of_a_wall() -> None:
    full = np.array([[100, 100, 100, 100, 100, 100], [0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0], [-1, -1, 0, 0, 0, 100]])
    assert map_reduction.judged(full, full, 1) == {
        'occupied kept [%]': 100, 'obstacles': 2, 'of them gone': 0, 'gaps': 0, 'grown [%]': 0}
    holed = full.copy()
    holed[0, 2], holed[3, 5], holed[3, 2] = 0, 0, 100
    assert map_reduction.judged(full, holed, 1) == {
        'occupied kept [%]': pytest.approx(100 * 5 / 7), 'obstacles': 2, 'of them gone': 1, 'gaps': 1,
        'grown [%]': pytest.approx(100 / 15)}
    reduced = np.array([[100, 0, 100], [0, 0, 100]])
    assert map_reduction.judged(full, reduced, 2) == {
        'occupied kept [%]': pytest.approx(100 * 5 / 7), 'obstacles': 2, 'of them gone': 0, 'gaps': 1,
        'grown [%]': pytest.approx(100 * 7 / 15)}


def test_how_far_lost_points_are_from_received_ones() -> None:
    whole = np.array([[0, 0, 0], [1, 0, 0], [5, 0, 0]], float)
    assert cloud_loss.distance(whole, whole) == 0
    assert cloud_loss.distance(whole, whole[:2]) == pytest.approx(4, abs=0.1)
    assert cloud_loss.distance(whole, whole[:0]) == np.inf


def test_the_docs_show_each_image_that_is_made_for_them() -> None:
    docs = ''.join(path.read_text() for path in sorted((TOP / 'doc').glob('*.md')))
    shown = re.findall(r'\]\(images/([^)]+)\)', docs)
    assert set(doc_images.IMAGES) <= set(shown)
    assert all((doc_images.FOLDER / name).stat().st_size <= doc_images.MAX_SIZE for name in shown)


@pytest.mark.parametrize('suffix', ['.jpg', '.png'])
def test_images_for_the_docs_are_made_small(suffix: str) -> None:
    noise = np.random.RandomState(2).randint(0, 256, (300, 2000, 3)).astype(np.uint8)
    noise[:, 500:] = 255
    small = cv2.imdecode(doc_images.shrunk(noise, suffix), cv2.IMREAD_COLOR)
    assert small.shape[1] in doc_images.WIDTHS and small.shape[1] / small.shape[0] == pytest.approx(2000 / 300, 0.01)
    with pytest.raises(ValueError):
        doc_images.shrunk(np.random.RandomState(2).randint(0, 256, (800, 600, 3)).astype(np.uint8), suffix)
