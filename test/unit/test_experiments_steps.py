# SPDX-License-Identifier: BSD-3-Clause
"""What the experiment over a link in steps counts with."""
import numpy as np
import pytest

for library in ('cv2', 'matplotlib', 'skimage', 'tqdm'):
    pytest.importorskip(library)

from benchmarks.pictures import BEST_PSNR  # noqa: E402
from experiments import adaptation, keeper, steps  # noqa: E402
from smokebot_udp.link_lab.listener import Heard  # noqa: E402


def counts(carried, dropped, waited, lost=0, offered=0):
    return {'robot': {'carried': carried, 'dropped': dropped, 'lost': lost, 'offered': offered},
            'waited': {'robot': waited}, 'late': {'p99': 0.001}}


def test_greys_and_counts():
    greys = np.arange(256, dtype=np.uint8)
    assert (keeper.to_grey(keeper.to_counts(greys)) == greys).all()
    assert keeper.to_grey([0, keeper.COLDEST, keeper.HOTTEST, 65535]).tolist() == [0, 0, 255, 255]


def test_a_file_of_pictures_may_be_being_written(tmp_path):
    pictures = np.arange(2 * keeper.HEIGHT * keeper.WIDTH, dtype='<u2')
    (tmp_path / 'kept').write_bytes(pictures.tobytes()[:-2])
    assert keeper.load(tmp_path / 'kept').shape == (1, keeper.HEIGHT, keeper.WIDTH)


def test_how_long_packets_waited_between_two_counts():
    before, after = counts(0, 0, {0: 50, 3: 5}), counts(0, 0, {0: 50, 3: 24, 40: 1})
    assert steps.waited(before, after, 0.5) == 3 and steps.waited(before, after, 0.95) == 3
    assert steps.waited(before, after, 0.96) == 40
    assert steps.waited(after, after, 0.5) is None


def test_what_the_link_carried_counts_from_2_s_after_the_step():
    step = steps.Told(1e6, 100.0, 104.0, [
        (100.0, counts(0, 0, {})), (101.0, counts(900000, 70, {9: 10}, 0, 100)),
        (102.0, counts(1000000, 72, {9: 20}, 10, 200)), (104.0, counts(1200000, 73, {9: 20, 7: 9}, 14, 241))])
    # 200 kB in 2 s of 250; 41 came, of which one found the queue full, and the air lost 4
    assert steps.of_link(step) == {'used [%]': 80.0, 'queue p50 [ms]': 7, 'queue p95 [ms]': 7, 'dropped': 3,
                                   'air lost [%]': 10.0, 'late p99 [ms]': 1.0}


def test_what_came_of_what_left():
    step = steps.Told(1e6, 100.0, 110.0, [])
    left = [Heard('a', at, at, 1) for at in (101.0, 103.0, 104.0, 105.0, 106.0, 109.8)]
    came = [Heard('b', at, at + 0.05, 1) for at in (101.0, 103.0, 104.0, 106.0)]
    assert steps.of_messages(left, came, step, ('a', 'b')) == {'left': 4, 'lost [%]': 25.0, 'age p99 [ms]': 50}
    assert steps.of_messages([], [], step, ('a', 'b')) == {'left': 0, 'lost [%]': None, 'age p99 [ms]': None}


def test_psnr():
    black = np.zeros((2, 2), np.uint8)
    assert steps.psnr(black, black) == BEST_PSNR
    assert steps.psnr(black, black + 255) == 0
    assert steps.psnr(black, black + 51) == pytest.approx(13.98, abs=0.01)


def test_shares_around_a_switch():
    rows = [{'time [s]': at, 'stream': name, 'rate [kbit/s]': rate} for at, name, rate in (
        (-1.0, 'thermal', 300.0), (-1.0, 'map', 100.0), (0.7, 'thermal', 100.0), (0.7, 'map', 100.0))]
    assert {row[0]: row[1:] for row in adaptation.of_switch(rows).rows} == {
        'thermal': [75.0, 0.0, 50.0, 0.0], 'map': [25.0, 0.0, 50.0, 0.0]}
