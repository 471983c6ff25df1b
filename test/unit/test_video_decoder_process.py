# SPDX-License-Identifier: BSD-3-Clause
"""Video is decoded in a process of its own, which may die, hang or lie: real processes."""
import os
import pathlib
import re
import signal
import subprocess
import sys
import threading
from typing import Any, Callable, Iterator, List

import numpy as np
import psutil
import pytest
from polling import wait_for
from video_scene import image, psnr, requests, video

from smokebot_udp.codecs.video.decoder_memory import Answer, Status
from smokebot_udp.nodes.video_decoder import VideoDecoder

HEIGHT, WIDTH = 96, 176
STREAM = requests(video(40, HEIGHT, WIDTH), HEIGHT, WIDTH)
PROCESS = 'import sys; from smokebot_udp.codecs.video import decoder, decoder_process; %s; sys.exit(%s)'
MAIN = 'decoder_process.main(*sys.argv[1:])'


@pytest.fixture
def logged(monkeypatch: Any) -> List[str]:
    texts: List[str] = []
    monkeypatch.setattr('rospy.logerr', lambda form, *values: texts.append(form % values))
    return texts


@pytest.fixture
def make(logged: List[str]) -> Iterator[Callable[..., VideoDecoder]]:
    made: List[VideoDecoder] = []

    def make(code: str = 'pass', main: str = MAIN) -> VideoDecoder:
        """A decoder whose process runs some code first, or something else than what decodes."""
        made.append(VideoDecoder('camera', (sys.executable, '-c', PROCESS % (code, main))))
        return made[-1]
    yield make
    for decoder in made:
        decoder.close()


def good(decoder: VideoDecoder, stream: Any = STREAM) -> bool:
    """Whether it decodes the first image of a stream."""
    shown = decoder.decode(stream[0])
    return shown is not None and psnr(shown, image(0, HEIGHT, WIDTH)) > 35


def test_the_images_are_those_of_the_scene_and_the_process_starts_with_the_first_one(logged: List[str]) -> None:
    decoder = VideoDecoder('camera')
    assert decoder.pid is None
    for number, request in enumerate(STREAM):
        shown = decoder.decode(request)
        assert shown is not None and shown.dtype == np.uint8 and shown.flags.c_contiguous
        assert psnr(shown, image(number, HEIGHT, WIDTH)) > 38
    process = psutil.Process(decoder.pid)
    decoder.close()
    assert not process.is_running() and not decoder.dropped and not logged


@pytest.mark.parametrize('height, width', [(95, 175), (17, 33), (240, 320)])
def test_colour_of_any_size(height: int, width: int, make: Any) -> None:
    decoder = make()
    for number, request in enumerate(requests(video(3, height, width, True), height, width, True)):
        shown = decoder.decode(request)
        assert shown.shape == (height, width, 3) and psnr(shown, image(number, height, width, True)) > 24


def test_a_killed_process_is_replaced(make: Any, logged: List[str]) -> None:
    decoder = make()
    assert good(decoder)
    first = decoder.pid
    os.kill(first, signal.SIGKILL)
    assert decoder.decode(STREAM[1]) is None
    assert decoder.pid not in (None, first)     # the next one is loading its libraries already
    assert good(decoder)
    assert decoder.dropped == {'decoder died': 1} and logged == ["stream 'camera': decoder died: SIGKILL"]


def test_a_stopped_process_is_replaced_and_holds_up_no_other_stream(make: Any, logged: List[str]) -> None:
    stopped, other = make(), make()
    assert good(stopped) and good(other)
    os.kill(stopped.pid, signal.SIGSTOP)
    begun, ended = threading.Event(), threading.Event()
    shown: List[Any] = []

    def show_other() -> None:
        while not ended.is_set():
            shown.append(other.decode(STREAM[len(shown) % len(STREAM)]))
            begun.set()
    thread = threading.Thread(target=show_other)
    thread.start()
    assert begun.wait(60)
    before = len(shown)
    assert stopped.decode(STREAM[1]) is None
    after = len(shown)
    ended.set()
    thread.join()
    assert after > before + 1 and all(each is not None for each in shown)
    assert good(stopped)
    assert stopped.dropped == {'decoder hung': 1} and not other.dropped
    assert logged == ["stream 'camera': decoder hung: no answer in time"]


def later(code: str) -> str:
    """A process that decodes by this code once it has passed its self-test."""
    return "decoder.Decoder.test = lambda self: setattr(decoder.Decoder, 'decode', lambda *_: %s)" % code


def test_a_process_that_computes_for_ever_is_replaced(make: Any) -> None:
    decoder = make(later('any(iter(int, 1))'))
    assert decoder.decode(STREAM[0]) is None and decoder.dropped == {'decoder hung': 1}


def test_a_process_that_wants_much_memory_gets_none_and_goes_on(make: Any) -> None:
    decoder = make(later('bytearray(1 << 29)'))
    assert decoder.decode(STREAM[0]) is None
    first = decoder.pid
    assert decoder.decode(STREAM[0]) is None and decoder.pid == first and decoder.dropped == {'undecodable': 2}


def test_restarts_of_a_process_that_always_dies_are_bounded(logged: List[str]) -> None:
    decoder = VideoDecoder('camera', ['false'])
    while decoder.dropped['no decoder'] < 3:
        assert decoder.decode(STREAM[0]) is None
    assert decoder.pid is None and set(decoder.dropped) == {'decoder died', 'no decoder'}
    assert set(logged) == {"stream 'camera': decoder died: exit code 1"}


def test_where_pyav_cannot_be_loaded_one_process_says_so(logged: List[str]) -> None:
    decoder = VideoDecoder('camera', (sys.executable, '-c', 'import sys; sys.modules["av"] = None; '
                                      'from smokebot_udp.codecs.video.decoder_process import main; '
                                      'sys.exit(main(*sys.argv[1:]))'))
    assert not decoder.broken
    for _ in range(3):
        assert decoder.decode(STREAM[0]) is None
    assert decoder.broken and decoder.dropped == {'decoder broken': 1, 'no decoder': 2}
    assert logged == ["stream 'camera': decoder broken: ModuleNotFoundError: import of av halted; None in sys.modules"]
    decoder.close()


READY = Answer(0, Status.READY)
DECODED = Answer(1, Status.DECODED, HEIGHT, WIDTH, (WIDTH, 0, 0))


@pytest.mark.parametrize('first, second', [
    (b'?' * 29, b''), (DECODED.to_bytes(), b''), (READY.to_bytes(), b'?'), (READY.to_bytes(), b'?' * 29),
    *((READY.to_bytes(), answer.to_bytes()) for answer in (
        READY, DECODED._replace(number=2), DECODED._replace(status=Status.BROKEN), DECODED._replace(height=2 ** 31),
        DECODED._replace(lines=(2 ** 31, 0, 0)), DECODED._replace(lines=(0, 0, 0))))])
def test_nonsense_is_not_believed(first: bytes, second: bytes, make: Any, logged: List[str]) -> None:
    main = 'os.write(1, %r), os.read(0, 99), os.write(1, %r), signal.pause()' % (first, second)
    decoder = make('import os, signal', main)
    assert decoder.decode(STREAM[0]) is None and decoder.dropped == {'decoder nonsense': 1} and len(logged) == 1


def test_a_long_image_does_not_block(make: Any) -> None:
    decoder = make()
    long = STREAM[0]._replace(slices=[STREAM[0].slices[0] + np.random.RandomState(1).bytes(400000)])
    decoder.decode(long)
    assert good(decoder)


def test_impossible_images_do_not_reach_the_process(make: Any) -> None:
    decoder = make()
    assert decoder.decode(STREAM[0]._replace(height=1 << 20)) is None
    assert decoder.pid is None and decoder.dropped == {'impossible image': 1}


def test_bad_video_is_counted_and_the_process_stays(make: Any) -> None:
    decoder = make()
    assert good(decoder)
    first = decoder.pid
    assert decoder.decode(STREAM[1]._replace(slices=[b'\x65'])) is None
    assert decoder.decode(STREAM[1]._replace(height=HEIGHT - 8)) is None
    assert decoder.dropped == {'undecodable': 1, 'unfit': 1} and decoder.pid == first


def test_the_process_has_its_pipes_and_its_memory_and_nothing_else(make: Any, monkeypatch: Any) -> None:
    monkeypatch.setenv('SMOKEBOT_KEY', 'secret')
    with open(__file__) as file:
        os.set_inheritable(file.fileno(), True)
        decoder = make()
        assert good(decoder)
        folder = pathlib.Path('/proc/%d' % decoder.pid)
        targets = sorted(os.readlink(str(path)).split(':')[0] for path in (folder / 'fd').iterdir())
    assert targets == ['/dev/null', '/memfd', 'pipe', 'pipe']
    assert b'secret' not in (folder / 'environ').read_bytes()
    assert re.search('Max open files +0 +0', (folder / 'limits').read_text())


def test_the_process_cannot_shorten_the_memory_that_the_node_reads(make: Any, logged: List[str]) -> None:
    decoder = make('import os', 'os.ftruncate(int(sys.argv[1]), 0)')
    assert decoder.decode(STREAM[0]) is None
    assert logged == ["stream 'camera': decoder died: exit code 1"]     # of the exception; otherwise it is 0


def test_the_process_ends_with_a_node_that_is_killed() -> None:
    code = ("import time; from smokebot_udp.nodes.video_decoder import VideoDecoder; import test_video_decoder as test;"
            "made = VideoDecoder('camera'); made.decode(test.STREAM[0]); print(made.pid, flush=True); time.sleep(600)")
    node = subprocess.Popen([sys.executable, '-c', code], stdout=subprocess.PIPE,
                            env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)})
    assert node.stdout is not None
    process = psutil.Process(int(node.stdout.readline()))
    node.kill()
    node.communicate()
    wait_for(lambda: not process.is_running() or process.status() == psutil.STATUS_ZOMBIE)


def test_closing_ends_a_decode_that_waits_for_the_process(make: Any) -> None:
    decoder = make('import time', 'time.sleep(600)')
    closing = threading.Thread(target=lambda: wait_for(lambda: decoder.pid) and decoder.close())
    closing.start()
    assert decoder.decode(STREAM[0]) is None
    closing.join()
    assert not decoder.dropped      # otherwise it would hang 5 s later
    assert decoder.decode(STREAM[0]) is None and decoder.pid is None
