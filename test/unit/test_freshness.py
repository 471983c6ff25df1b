# SPDX-License-Identifier: BSD-3-Clause
from typing import Any, Callable

import numpy as np
import pytest

from smokebot_udp.streams.image.freshness import MAX_GAP, MotionMeter, Repeats

NOISE = np.random.RandomState(1)


def measured(picture: Callable[[int], Any], count: int = 30, period: float = 0.1) -> float:
    meter = MotionMeter()
    for k in range(count):
        meter.add(picture(k), k * period)
    return meter.growth


def test_a_scene_that_stands_is_not_outdated_however_noisy_it_is() -> None:
    still = 100.0 + NOISE.rand(240, 320) * 50
    noisy = measured(lambda k: (still + 3 * NOISE.randn(240, 320)).astype(np.uint8))
    assert noisy < 0.1 * 2 * 3 ** 2 / 0.1       # of what noise is between two images
    assert measured(lambda k: still.astype(np.uint8)) == 0.0


def test_a_scene_that_walks_is_outdated_at_the_rate_of_its_steps() -> None:
    """Each image adds independent steps: the mean squared difference grows by their variance."""
    walk, steps = np.zeros((240, 320)), np.random.RandomState(2)

    def step(k: int) -> Any:
        walk[...] += 2.0 * steps.randn(240, 320)
        return (1000 + walk).astype(np.uint16)
    assert measured(step) == pytest.approx(2.0 ** 2 / 0.1, rel=0.15)


def test_cells_that_are_no_numbers_are_not_compared() -> None:
    """Holes that flicker in a scene that stands; and one that changes in the other half."""
    random = np.random.RandomState(3)
    for step in (0, 20):
        meter = MotionMeter()
        for k in range(20):
            pixels, classes = np.full((64, 64), 5000, np.uint16), np.zeros((64, 64), np.uint8)
            pixels[32:] += np.uint16(step * k)
            classes[:32] = random.random_sample((32, 64)) < 0.5
            pixels[classes > 0] = random.randint(65536)
            meter.add(pixels, 0.1 * k, classes)
        # steps of 20: squares of 40 and 20 counts, in half of the cells
        assert meter.growth == pytest.approx((1600 - 400) / 2 / 0.1 if step else 0.0, rel=0.01)
    nothing = MotionMeter()
    for k in range(5):
        nothing.add(np.zeros((8, 8), np.uint16), 0.1 * k, np.ones((8, 8), np.uint8))
    assert nothing.growth == 0.0


@pytest.mark.parametrize('change', ['size', 'pause', 'stamps go backwards'])
def test_what_cannot_be_compared_is_forgotten(change: str) -> None:
    meter = MotionMeter()
    for k in range(10):
        meter.add(np.full((16, 16), 20 * k, np.uint8), 0.1 * k)
    assert meter.growth > 0
    meter.add(np.zeros((16, 20 if change == 'size' else 16), np.uint8),
              {'size': 1.0, 'pause': 1.0 + MAX_GAP, 'stamps go backwards': 0.5}[change])
    assert meter.growth == 0


def test_a_scene_that_is_another_one_in_each_image_is_not_outdated_further() -> None:
    """Its differences are large, but the older one is no larger than the newer one, on average."""
    growth = measured(lambda k: NOISE.randint(0, 256, (240, 320)).astype(np.uint8), 60)
    assert growth < 0.05 * 2 * 255 ** 2 / 12 / 0.1


def test_repeats_are_counted_until_anything_changes() -> None:
    repeats, pixels, classes = Repeats(), np.full((5, 7), 9, np.uint16), np.zeros((5, 7), np.uint8)
    other, others = pixels.copy(), classes.copy()
    other[4, 6], others[4, 6] = 8, 1
    found = []
    for image in ((pixels,), (pixels.copy(),), (pixels,), (other,), (other,), (other[1:],), (other, classes),
                  (other, classes.copy()), (other, others), (other, others), (other,)):
        repeats.add(*image)
        found.append(repeats.count)
    assert found == [0, 1, 2, 0, 1, 0, 0, 1, 0, 1, 0]
