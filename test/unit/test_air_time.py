# SPDX-License-Identifier: BSD-3-Clause
"""air_time: however much of the link there is, an image takes no longer."""
import pytest
from layered_sender import CASES, DATAGRAM, NO_LOSS, encoder, image, settings

from smokebot_udp.streams.image.image_size import LEAST_BYTES
from smokebot_udp.streams.segments import size_on_air

ROOM = 200e3


@pytest.mark.parametrize('coding', ['layered', 'interleaved'])
@pytest.mark.parametrize('air_time, size', [(0.03, 6000), (0.015, 3000), (1e-4, max(LEAST_BYTES, DATAGRAM + 28))])
def test_an_image_takes_no_longer_on_the_air(coding: str, air_time: float, size: int) -> None:
    of = settings(coding=coding, air_time=air_time)
    made = encoder(of, NO_LOSS._replace(room=ROOM))
    sent = [size_on_air(made.encode(image(CASES['mono16'], 'mono16', k), of, DATAGRAM)) for k in (1, 2, 3)]
    assert size / 3 < max(sent) <= size


@pytest.mark.parametrize('coding', ['layered', 'interleaved'])
def test_a_link_without_a_limit_has_time_for_all_of_it(coding: str) -> None:
    sizes = []
    for air_time in (0.0, 0.001):
        of = settings(coding=coding, air_time=air_time)
        made = encoder(of, NO_LOSS)
        sizes.append([size_on_air(made.encode(image(CASES['mono16'], 'mono16', k), of, DATAGRAM)) for k in (1, 2)])
    assert sizes[0] == sizes[1]


def test_the_setting_never_adds_time() -> None:
    for air_time, time in ((0.0, 0.1), (5.0, 0.1), (0.02, 0.02)):
        of = settings(air_time=air_time)
        made = encoder(of, NO_LOSS._replace(room=ROOM / 5))
        assert 0.8 * time < size_on_air(made.encode(image(CASES['mono16'], 'mono16'), of, DATAGRAM)) / ROOM * 5 <= time
