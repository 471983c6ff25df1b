# SPDX-License-Identifier: BSD-3-Clause
"""What a node shares with the process that decodes its video: records, the layout of planes, pixels."""
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some

from smokebot_udp.codecs.video import decoder_request
from smokebot_udp.codecs.video.decoder_memory import PLANES_AT, SIZE, Answer, Command, Plane, Status, layout
from smokebot_udp.codecs.video.decoder_pixels import pixels
from smokebot_udp.codecs.video.decoder_request import Request

COMMAND = Command(1, 0xdeadbeef, 480, 640, 35, 1300, True)
ANSWER = Answer(1, Status.DECODED, 480, 640, (704, 352, 352))
GREY = Request(1, 3, 5, False, b'', [b'\x41'])
COLOUR = GREY._replace(colour=True)


def test_a_command_is_these_bytes() -> None:
    data = bytes.fromhex('53425601' '01000000' 'efbeadde' 'e0010000' '80020000' '23000000' '14050000' '01')
    assert COMMAND.to_bytes() == data and Command.from_bytes(data) == COMMAND


def test_an_answer_is_these_bytes() -> None:
    data = bytes.fromhex('53425601' '01000000' '02' 'e0010000' '80020000' 'c0020000' '60010000' '60010000')
    assert ANSWER.to_bytes() == data and Answer.from_bytes(data) == ANSWER


@pytest.mark.parametrize('data', [
    b'', COMMAND.to_bytes()[:-1], COMMAND.to_bytes() + b'\0', b'SBV\x02' + COMMAND.to_bytes()[4:]])
def test_what_is_no_command_is_refused(data: bytes) -> None:
    with pytest.raises(ValueError):
        Command.from_bytes(data)


@pytest.mark.parametrize('data', [
    b'', ANSWER.to_bytes()[:-1], ANSWER.to_bytes() + b'\0', b'SBV\x02' + ANSWER.to_bytes()[4:],
    ANSWER.to_bytes()[:8] + b'\x05' + ANSWER.to_bytes()[9:]])
def test_what_is_no_answer_is_refused(data: bytes) -> None:
    with pytest.raises(ValueError):
        Answer.from_bytes(data)


def test_planes_follow_each_other_with_their_padded_lines() -> None:
    at = PLANES_AT
    assert layout(5, 7, (32, 16, 16)) == [
        Plane(at, 5, 7, 32), Plane(at + 160, 3, 4, 16), Plane(at + 160 + 48, 3, 4, 16)]


@pytest.mark.parametrize('height, width, lines', [
    (4, 8, (7,)), (4, 8, (8, 3, 4)), (4, 8, (8, 4, 0)), (4, 8, (2 ** 32 - 1,)), (2 ** 32 - 1, 1, (1,))])
def test_planes_that_do_not_fit_are_refused(height: int, width: int, lines: tuple) -> None:
    with pytest.raises(ValueError):
        layout(height, width, lines)


def memory_with(planes: dict) -> np.ndarray:
    """{offset: bytes} behind PLANES_AT; 99 elsewhere."""
    memory = np.full(SIZE, 99, np.uint8)
    for start, data in planes.items():
        memory[PLANES_AT + start:PLANES_AT + start + len(data)] = np.frombuffer(data, np.uint8)
    return memory


def test_grey_pixels_are_those_of_luma_without_padding() -> None:
    memory = memory_with({0: b'\1\2\3\4\5\0\0\0', 8: b'\6\7\x08\x09\x0a\0\0\0', 16: b'\x0b\x0c\x0d\x0e\x0f\0\0\0'})
    shown = pixels(memory, Answer(1, Status.DECODED, 4, 6, (8, 0, 0)), GREY)
    assert shown.tolist() == [[1, 2, 3, 4, 5], [6, 7, 8, 9, 10], [11, 12, 13, 14, 15]]
    memory[:] = 0
    assert shown[0, 0] == 1     # a copy


def test_colour_pixels_are_converted_from_video_levels() -> None:
    # BT.601: 16 is black, 235 white; Y 81, U 90, V 240 is red
    lines = b'\x10\x10\xeb\xeb\x51\x51??' * 2 + b'\xeb\xeb\x10\x10\x51\x51??' * 2
    u, v = b'\x80\x80\x5a?' + b'\x80\x80\x5a?', b'\x80\x80\xf0?' * 2
    shown = pixels(memory_with({0: lines, 32: u, 40: v}), Answer(1, Status.DECODED, 4, 6, (8, 4, 4)), COLOUR)
    assert shown.shape == (3, 5, 3)
    black, white, red = [0, 0, 0], [255, 255, 255], shown[0, 4].tolist()
    assert shown.tolist() == 2 * [[black, black, white, white, red]] + [[white, white, black, black, red]]
    assert red[0] <= 1 and red[1] <= 1 and red[2] >= 253     # blue, green, red


@pytest.mark.parametrize('request_, answer', [
    (GREY, Answer(1, Status.DECODED, 2, 6, (8, 0, 0))), (GREY, Answer(1, Status.DECODED, 4, 7, (8, 0, 0))),
    (GREY, Answer(1, Status.DECODED, 4, 6, (5, 0, 0))), (GREY, Answer(1, Status.DECODED, 4, 5, (8, 0, 0))),
    (GREY, Answer(1, Status.DECODED, 4, 6, (2 ** 31, 0, 0))), (COLOUR, Answer(1, Status.DECODED, 4, 6, (8, 0, 0))),
    (COLOUR, Answer(1, Status.DECODED, 3, 6, (8, 4, 4))), (COLOUR, Answer(1, Status.DECODED, 4, 6, (8, 4, 2 ** 31)))])
def test_impossible_answers_are_refused(request_: Request, answer: Answer) -> None:
    with pytest.raises(ValueError):
        pixels(np.zeros(SIZE, np.uint8), answer, request_)


LIKELY = some.sampled_from([3, 4, 5, 6, 8]) | some.integers(0, 2 ** 32 - 1)


@given(LIKELY, LIKELY, some.booleans(), some.tuples(
    LIKELY, LIKELY, LIKELY))
def test_whatever_the_process_answers_nothing_beside_the_planes_is_read(
        height: int, width: int, colour: bool, lines: tuple) -> None:
    asked = GREY._replace(colour=colour)
    try:
        shown = pixels(np.zeros(SIZE, np.uint8), Answer(1, Status.DECODED, height, width, lines), asked)
    except ValueError:
        return
    assert shown.shape[:2] == (3, 5)


@pytest.mark.parametrize('change', [
    {'session': -1}, {'session': 2 ** 32}, {'height': 0}, {'width': 0}, {'height': 16385},
    {'height': 4096, 'width': 1025}, {'slices': []}, {'slices': [b'\x41' * decoder_request.MAX_BYTES]},
    {'parameter_sets': bytes(decoder_request.MAX_BYTES)}])
def test_impossible_requests_are_refused(change: dict) -> None:
    GREY.check()
    with pytest.raises(ValueError):
        GREY._replace(**change).check()
