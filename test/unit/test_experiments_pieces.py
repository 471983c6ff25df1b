# SPDX-License-Identifier: BSD-3-Clause
"""What the experiments without a network are made of."""
import re

import numpy as np
import pytest

for library in ('cv2', 'matplotlib', 'skimage', 'tqdm'):
    pytest.importorskip(library)

import cv2  # noqa: E402

from benchmarks.pictures import BEST_PSNR  # noqa: E402
from experiments import cloud_loss, doc_pictures, jpeg, lossy, map_reduction  # noqa: E402
from experiments.screen import GREY, HEIGHT, WIDTH, Screen  # noqa: E402

PICTURE = np.random.RandomState(1).randint(0, 256, (240, 320)).astype(np.uint8)


@pytest.mark.parametrize('fill', lossy.FILLS)
def test_a_whole_picture_comes_as_it_was_sent_and_of_nothing_comes_nothing(fill):
    receiver, frames = lossy.images(fill), lossy.robot('image').frames(lossy.message_of(PICTURE))
    came = np.ones(lossy.count(frames), bool)
    assert (lossy.picture_of(lossy.came_of(receiver, frames, came)) == PICTURE).all()
    came[1::2] = False
    few = lossy.picture_of(lossy.came_of(receiver, frames, came))
    assert 0.5 < (few == PICTURE).mean() < 0.6      # some are filled as they were
    assert lossy.came_of(receiver, frames, ~np.ones_like(came)) is None


def test_segments_are_taken_in_the_order_of_sending_across_frames():
    frames = lossy.robot('image').frames(lossy.message_of(PICTURE[:200, :300]))
    assert len(frames) > 1      # the last segment is shorter
    came = np.zeros(lossy.count(frames), bool)
    came[[0, 2, -1]] = True
    first, last = lossy.records_of(frames, came)
    assert first['index'].tolist() == frames[0].records['index'][[0, 2]].tolist()
    assert last['index'].tolist() == [frames[-1].records['index'][-1]]


def test_codes():
    code = jpeg.Code(2, 3, 1500)
    assert code.restored(0.5) == pytest.approx(0.5)        # 2 or 3 of 3: (3 + 1) / 8
    assert code.room == 2 * (1500 - 28 - 8) - jpeg.HEAD
    assert [code.data for code in jpeg.codes(4500)] == [1, 2, 3]
    assert {code.size * code.packets for code in jpeg.codes(4000)} == {4000}
    assert jpeg.with_overhead(56 * 1500, 0.25)[:2] == (44, 56)       # 45 would need 56.25


def test_the_code_that_knows_the_loss_adds_none_without_and_much_with_it():
    ladder = jpeg.Ladder(cv2.GaussianBlur(PICTURE, (0, 0), 2))
    assert jpeg.for_loss(12 * 1500, 0.0, [ladder])[:2] == (12, 12)
    assert 1 < jpeg.for_loss(12 * 1500, 0.5, [ladder]).data < 6


def test_the_best_jpeg_is_the_best_that_fits():
    ladder = jpeg.Ladder(PICTURE)
    assert ladder.best(10) is None and ladder.decoded(10) is None
    rooms = 3000, 10000, 100000
    steps = [ladder.best(room) for room in rooms]
    assert all(step.size <= room for step, room in zip(steps, rooms))
    assert steps[0].psnr < steps[1].psnr < steps[2].psnr
    assert steps[0].scale > 1 and steps[2].scale == 1      # noise is too much for few bytes
    assert ladder.decoded(100000).shape == PICTURE.shape


def test_what_is_not_shown_stays_and_is_compared_with_now():
    screen, black, white = Screen(), *(np.full((HEIGHT, WIDTH), value, np.uint8) for value in (0, 255))
    screen.show(None, white)
    assert (screen.shown[-1] == GREY).all()
    screen.show(black, black)
    screen.show(None, white)
    screen.show(None, black)
    row = screen.row()
    assert row['new pictures [%]'] == 25 and row['SSIM'] == 1.0
    grey = 20 * np.log10(255 / (255 - GREY))
    picture, psnr, new = screen.typical()
    assert (picture == black).all() and psnr == BEST_PSNR and new
    assert row['PSNR [dB]'] == pytest.approx((grey + BEST_PSNR + 0 + BEST_PSNR) / 4, abs=1e-3)


def test_what_is_kept_of_a_wall():
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


def test_how_far_lost_points_are_from_those_that_came():
    whole = np.array([[0, 0, 0], [1, 0, 0], [5, 0, 0]], float)
    assert cloud_loss.farthest(whole, whole) == 0
    assert cloud_loss.farthest(whole, whole[:2]) == pytest.approx(4, abs=0.1)
    assert cloud_loss.farthest(whole, whole[:0]) == np.inf


def test_the_docs_show_each_picture_that_is_made_for_them():
    docs = ''.join(path.read_text() for path in sorted((doc_pictures.TOP / 'doc').glob('*.md')))
    shown = re.findall(r'\]\(images/([^)]+)\)', docs)
    assert set(doc_pictures.PICTURES) <= set(shown)
    assert all((doc_pictures.FOLDER / name).stat().st_size <= doc_pictures.MOST for name in shown)


@pytest.mark.parametrize('suffix', ['.jpg', '.png'])
def test_pictures_for_the_docs_are_made_small(suffix):
    noise = np.random.RandomState(2).randint(0, 256, (300, 2000, 3)).astype(np.uint8)
    noise[:, 500:] = 255
    small = cv2.imdecode(doc_pictures.shrunk(noise, suffix), cv2.IMREAD_COLOR)
    assert small.shape[1] in doc_pictures.WIDTHS and small.shape[1] / small.shape[0] == pytest.approx(2000 / 300, 0.01)
    with pytest.raises(ValueError):
        doc_pictures.shrunk(np.random.RandomState(2).randint(0, 256, (800, 600, 3)).astype(np.uint8), suffix)
