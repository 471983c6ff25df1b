# SPDX-License-Identifier: BSD-3-Clause
"""Cookies prove an address for one to two minutes."""
from link_channel import random_bytes

from smokebot_udp.link.cookie import LIFETIME, CookieJar
from smokebot_udp.link.place import Place
from smokebot_udp.udpros.control_messages import Via

PLACE = Place(0x0a000009, 40001)
NONCE = 7


def test_it_is_good_for_one_place_and_nonce_and_robot_only() -> None:
    jar = CookieJar(random_bytes(1))
    cookie = jar.make(PLACE, NONCE, 0.0)
    assert len(cookie) == 16
    assert jar.is_valid(cookie, PLACE, NONCE, 1.0)
    assert not jar.is_valid(cookie, PLACE._replace(number=PLACE.number + 1), NONCE, 1.0)
    assert not jar.is_valid(cookie, PLACE._replace(port=PLACE.port + 1), NONCE, 1.0)
    assert not jar.is_valid(cookie, PLACE, NONCE + 1, 1.0)
    assert jar.is_valid(cookie, PLACE._replace(via=Via(3)), NONCE, 1.0)
    assert not jar.is_valid(bytes([cookie[0] ^ 1]) + cookie[1:], PLACE, NONCE, 1.0)
    assert not CookieJar(random_bytes(2)).is_valid(cookie, PLACE, NONCE, 1.0)


def test_it_outlives_one_change_of_the_secret_and_not_two() -> None:
    jar = CookieJar(random_bytes(1))
    cookie = jar.make(PLACE, NONCE, LIFETIME - 0.1)
    assert jar.is_valid(cookie, PLACE, NONCE, LIFETIME + 0.1)
    assert jar.is_valid(cookie, PLACE, NONCE, 2 * LIFETIME - 0.1)
    assert not jar.is_valid(cookie, PLACE, NONCE, 2 * LIFETIME + 0.1)


def test_it_does_not_outlive_a_rest_of_the_robot() -> None:
    jar = CookieJar(random_bytes(1))
    cookie = jar.make(PLACE, NONCE, 0.0)
    assert not jar.is_valid(cookie, PLACE, NONCE, 10 * LIFETIME)


def test_the_secret_is_another_each_time() -> None:
    jar = CookieJar(random_bytes(1))
    cookies = {jar.make(PLACE, NONCE, slot * LIFETIME) for slot in range(20)}
    assert len(cookies) == 20
