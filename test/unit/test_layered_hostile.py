# SPDX-License-Identifier: BSD-3-Clause
"""Bad segments of layered images on the operator's side: refused, counted, and bound in memory."""
import math
import random
import subprocess
import sys
import threading
import tracemalloc
from types import SimpleNamespace
from typing import Any, List, Tuple

import needs_numba  # noqa: F401
import numpy as np
import pytest
from layered_operator import (
    COUNT,
    ERRORS,
    THRESHOLDS,
    Operator,
    pixels_of,
    scene,
    segments,
)
from polling import WAIT

from smokebot_udp.codecs.layered.quality import from_byte
from smokebot_udp.codecs.wire.partial_image import MAX_IMAGE_SIZE
from smokebot_udp.msg import LayeredSegment
from smokebot_udp.streams.image.layered import LayeredImage
from smokebot_udp.streams.image.size_guard import FIRST, PROOF, SizeGuard
from smokebot_udp.udpros.frame import Frame

IMPOSSIBLE: List[Tuple[str, Any]] = [
    ('height', 0), ('width', 0), ('height', 4097), ('width', 2 ** 32 - 1), ('encoding', ord('x')),
    ('depth_unit', 0.1), ('depth_unit', math.inf), ('depth_unit', math.nan), ('depth_unit', -1.0),
    ('count', 0), ('count', 3), ('count', 65535), ('count', 241),
    ('thresholds', [0, 4, 9]), ('thresholds', [4, 1, 9]), ('thresholds', [1, 4, 4]), ('thresholds', [1, 4, 13]),
    ('sizes', [0, 1, 1]), ('sizes', [65535, 65535, 65535])]


@pytest.mark.parametrize('field, value', IMPOSSIBLE)
def test_an_impossible_head_begins_no_image(field: str, value: Any) -> None:
    operator, forged = Operator(), segments(scene(), 8)
    forged[field] = value
    assert operator(segments(scene(), 7)[:8], 1.0) == []
    assert operator(forged, 1.0) == [] and operator.dropped == {'impossible head': COUNT}
    assembled, = operator(segments(scene(), 7)[8:], 1.0)      # the image in progress goes on
    assert (pixels_of(assembled) == scene()).all()


@pytest.mark.parametrize('field, value', [
    *IMPOSSIBLE, ('errors', [1, 1, 1]), ('count', 13), ('height', 47), ('encoding', ord('y')), ('is_bigendian', 1)])
def test_a_head_that_contradicts_the_image_in_progress_changes_nothing(field: str, value: Any) -> None:
    operator, forged = Operator(), segments(scene(), 7)
    forged[field] = value
    operator(segments(scene(), 7)[:8], 1.0)
    assert operator(forged, 1.0) == [] and operator.dropped == {'contradiction': COUNT}
    assembled, = operator(segments(scene(), 7)[8:], 1.0)
    assert (pixels_of(assembled) == scene()).all()


def test_tables_of_different_lengths_and_pieces_that_do_not_fit() -> None:
    operator = Operator()
    for lengths in ({'thresholds': 2}, {'sizes': 2}, {'errors': 4}, {'errors': 0}):
        frame = Frame(LayeredSegment, 1, {'encoding': 6, 'thresholds': 3, 'sizes': 3, 'errors': 3, 'data': 99,
                                          **lengths})
        good = segments(scene(), 7)
        for field in ('height', 'width', 'count'):
            frame.records[field] = good[field][0]
        frame.records['encoding'] = good['encoding'][0]
        for field, values in (('thresholds', THRESHOLDS), ('sizes', (33, 33, 33))):
            frame.records[field] = values[:frame.records[field].shape[1]]
        operator(frame.records, 1.0)
    assert operator.dropped == {'impossible head': 4} and operator.poll(9.0) == []
    out = segments(scene(), 7)
    out['index'] += COUNT
    assert operator(out, 10.0) == [] and operator.dropped == {'impossible head': 4, 'contradiction': COUNT}


def head(**changes: Any) -> SimpleNamespace:
    """As of images of 480 x 640 pixels."""
    return SimpleNamespace(**{'height': 480, 'width': 640, 'encoding': 'mono8', 'is_bigendian': 0, 'depth_unit': 0.0,
                              'count': 240, 'thresholds': (120,), 'sizes': (4112,), 'errors': (0,), 'session': 0,
                              'picture': 0, 'reference': 0, 'reference_layers': 0, 'checksum': 0, **changes})


@pytest.mark.parametrize('codes', [2, 17])
def test_a_stream_is_not_much_longer_than_the_pixels_however_many_codes_it_has(codes: int) -> None:
    """The pixels have 307200 bytes, one code 493440."""
    with pytest.raises(ValueError, match='a stream of %d bytes' % (493440 * codes)):
        LayeredImage(head(count=240 * codes), SizeGuard(), 0.0)
    LayeredImage(head(count=240 * codes, sizes=(4112 // codes,)), SizeGuard(), 0.0)


@pytest.mark.parametrize('changes', [
    {'height': 4096, 'width': 1024}, {'encoding': 'mono16', 'width': 1024},     # above the guard's bound
    {'thresholds': (120, 100)}, {'height': 1, 'width': 1}])
def test_what_is_refused_takes_no_memory(changes: Any) -> None:
    tracemalloc.start()
    try:
        with pytest.raises(ValueError):
            LayeredImage(head(**{'count': 4080, 'sizes': (240,), 'thresholds': (120,), **changes}), SizeGuard(), 0.0)
        assert tracemalloc.get_traced_memory()[1] < 100000
    finally:
        tracemalloc.stop()


def test_copies_of_datagrams_are_no_contradiction() -> None:
    operator, records = Operator(), segments(scene(), 7)
    assert operator(np.concatenate([records[:4]] * 3), 1.0) == [] and operator.dropped == {}
    assembled, = operator.poll(2.0)
    assert assembled.error is not None and assembled.error.rms == from_byte(ERRORS[1])


def test_a_stream_of_another_image_is_not_published() -> None:
    operator, forged = Operator(), segments(scene(), 7)
    forged['height'], forged['width'] = 64, 48
    assert operator(forged, 1.0) == [] and operator.dropped == {'image': 1}
    assert len(operator(segments(scene(), 8), 1.1)) == 1


def announce(operator: Operator, height: int, width: int, seconds: int, now: float) -> bool:
    """Whether an image of this size is begun; nothing of it can be decoded."""
    before = operator.dropped.get('impossible head', 0)
    records = segments(scene(), seconds)[:1]
    records['height'], records['width'] = height, width
    operator(records, now)
    return operator.dropped.get('impossible head', 0) == before


def test_sizes_are_bound_by_what_good_images_had() -> None:
    operator = Operator()
    assert len(operator(segments(scene(), 1), 1.0)) == 1
    assert announce(operator, 4096, 4096, 2, 1.1) is False          # above every limit
    assert announce(operator, 1024, 1025, 3, 1.2) is False
    for step in range(40):      # a forger beside the source
        now = 1.3 + 0.1 * step
        assert len(operator(segments(scene(step), 4 + step), now)) == 1
        assert announce(operator, 2048, 2048, 1000 + step, now) is False
        for _ in range(3):
            assert announce(operator, 1024, 1025, 1000 + step, now) is False


def test_images_are_decoded_while_segments_are_received() -> None:
    """A guard is changed by one thread at a time."""
    guard, waits = SizeGuard(), []

    class Cells(int):
        """A size that is compared while another thread has decoded an image."""
        def __gt__(self, other: Any) -> bool:
            return int(self) > other

        def __ne__(self, other: Any) -> bool:
            decoded = threading.Thread(target=guard.good, args=(FIRST, 1.0), daemon=True)
            decoded.start()
            decoded.join(0.1)
            waits.append(decoded)
            assert decoded.is_alive()
            return int(self) != other

        __hash__ = int.__hash__
    with pytest.raises(ValueError):
        guard.check(Cells(FIRST + 1), 1.0)
    waits[0].join(WAIT)
    assert not waits[0].is_alive()
    with pytest.raises(ValueError):     # the good image of the bound's size came in between
        guard.check(FIRST + 1, 1.0 + PROOF)


def test_a_source_may_change_its_size() -> None:
    operator = Operator()
    for second in range(1, 15):
        assert len(operator(segments(scene(), second), float(second))) == 1
    larger = [segments(scene(shape=(96, 128)), second) for second in (20, 21, 22)]
    assert operator(larger[0], 20.0) == [] and operator(larger[1], 20.0 + PROOF / 2) == []
    for records, now in ((larger[2], 20.0 + PROOF), (segments(scene(), 23), 21.1), (larger[0], 30.0)):
        assembled, = operator(records, now)
    assert assembled.message.height == 96


def test_a_source_may_change_its_size_again_and_again() -> None:
    """Every 0.5 s another random size: something is shown of each second, as a size that is not larger is not held."""
    guard, chance = SizeGuard(), random.Random(1)
    shown = 0.0
    for step in range(8 * 600):     # ten minutes at 8 Hz
        now = step / 8
        if step % 4 == 0:
            cells = chance.randint(1, 800) * chance.randint(1, 600) * chance.choice((1, 1, 1, 3, 3))
        try:
            guard.check(cells, now)
        except ValueError:
            assert now - shown < 1.0
        else:
            guard.good(cells, now + 0.05)
            shown = now


def test_an_image_above_the_first_bound_is_shown_after_a_while() -> None:
    assert FIRST < 2048 * 1024 < MAX_IMAGE_SIZE
    operator = Operator()
    assert announce(operator, 1024, 2048, 1, 1.0) is False and announce(operator, 1024, 2048, 2, 1.4) is False
    assert announce(operator, 1024, 2048, 3, 1.0 + PROOF) is True


def test_numba_is_loaded_with_the_first_layered_image_only() -> None:
    code = ('import sys\n'
            'from smokebot_udp.nodes import operator_stream, image_outputs\n'
            'from smokebot_udp.streams import assembler_class, encoder_class\n'
            'assembler_class("image"); encoder_class("image")\n'
            'sys.exit("numba" in sys.modules)')
    assert subprocess.run([sys.executable, '-c', code], check=False).returncode == 0
