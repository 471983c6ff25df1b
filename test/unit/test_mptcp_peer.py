# SPDX-License-Identifier: BSD-3-Clause
"""JPEG over multipath TCP without a network."""
import io
import pathlib
import socket
from typing import Any

import cv2
import numpy as np
import pytest

from evaluation import mptcp_method
from evaluation.mptcp_method import Jpeg, MultipathTcp
from evaluation.mptcp_peer import NewestQueue, coded, framed, images_of


def test_images_are_found_again_in_the_stream() -> None:
    stream = framed(7, b'first') + framed(9, b'') + framed(2 ** 32 - 1, b'last')
    assert list(images_of(io.BytesIO(stream))) == [(7, b'first'), (9, b''), (2 ** 32 - 1, b'last')]


@pytest.mark.parametrize('rest', [0, 1, 7, 8, 10])
def test_an_image_that_is_cut_off_does_not_count(rest: int) -> None:
    stream = framed(7, b'first') + framed(8, b'second')[:rest]
    assert list(images_of(io.BytesIO(stream))) == [(7, b'first')]


def test_an_image_is_smaller_and_less_exact_at_a_lower_quality() -> None:
    image = cv2.GaussianBlur(np.random.RandomState(1).randint(0, 256, (48, 64)).astype(np.uint8), (5, 5), 0)
    low, high = coded(image, 20), coded(image, 90)
    errors = [np.abs(cv2.imdecode(np.frombuffer(one, np.uint8), cv2.IMREAD_GRAYSCALE) - image.astype(float)).mean()
              for one in (low, high)]
    assert len(low) < len(high) and errors[0] > errors[1]


def test_only_the_newest_image_waits() -> None:
    newest = NewestQueue()
    newest.put(b'1')
    newest.put(b'2')
    assert newest.get() == b'2'
    newest.put(b'3')
    assert newest.get() == b'3'


def test_a_kernel_without_multipath_tcp_is_named(monkeypatch: Any, tmp_path: pathlib.Path) -> None:
    def refused() -> socket.socket:
        raise OSError(93, 'Protocol not supported')
    monkeypatch.setattr(mptcp_method, 'open_socket', refused)
    stack: Any = None
    with pytest.raises(RuntimeError, match='the kernel has no multipath TCP: .*Protocol not supported'):
        MultipathTcp(stack, tmp_path / 'screen', Jpeg(60, 'cubic'))
