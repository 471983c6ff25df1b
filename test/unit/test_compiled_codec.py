# SPDX-License-Identifier: BSD-3-Clause
"""How the compiled codec is loaded: once, in the background, with one message."""
import subprocess
import sys
import threading
from typing import Any, Callable, List

import pytest
import rospy
from polling import WAIT

from smokebot_udp.nodes import compiled_codec
from smokebot_udp.nodes.compiled_codec import INSTEAD, MISSING, CompiledCodec


@pytest.fixture
def logged(monkeypatch: Any) -> List[str]:
    texts: List[str] = []
    for level in 'logwarn', 'logerr':
        monkeypatch.setattr(rospy, level, lambda form, *values: texts.append(form % values))
    return texts


def wait(codec: CompiledCodec) -> None:
    """Until it is loaded or cannot be."""
    for thread in threading.enumerate():
        if thread.name == 'codec':
            thread.join(WAIT)


def test_it_is_loaded_once_when_it_is_needed_first(logged: List[str]) -> None:
    loads, go = [], threading.Event()

    def load(compiling: Callable[[], None]) -> None:
        loads.append(1)
        assert go.wait(WAIT)
    codec = CompiledCodec(load)
    assert codec.problem is None and loads == []
    assert not codec.ready() and not codec.ready()
    assert codec.problem == 'layered images and maps in tiles wait: their codec is being loaded'
    go.set()
    wait(codec)
    assert codec.ready() and codec.problem is None and loads == [1] and logged == []


def test_while_it_is_compiled_one_message_says_so(logged: List[str]) -> None:
    began, go = threading.Event(), threading.Event()

    def load(compiling: Callable[[], None]) -> None:
        compiling()
        began.set()
        assert go.wait(WAIT)
    codec = CompiledCodec(load)
    assert not codec.ready() and began.wait(WAIT)
    for _ in range(5):
        assert not codec.ready()
    assert codec.problem is not None and 'compiled' in codec.problem and len(logged) == 1
    go.set()
    wait(codec)
    assert codec.ready() and len(logged) == 1


def failing(error: Exception) -> Callable[[Callable[[], None]], None]:
    def load(compiling: Callable[[], None]) -> None:
        raise error
    return load


def test_without_numba_one_error_names_the_package_and_what_to_do(logged: List[str]) -> None:
    codec = CompiledCodec(failing(ModuleNotFoundError("No module named 'numba'", name='numba')))
    for _ in range(3):
        assert not codec.ready()
        wait(codec)
    assert codec.problem == MISSING and logged == [MISSING]
    assert all(part in MISSING for part in ('python3-numba', 'apt install', 'restart', 'interleaved'))


def test_numba_that_is_not_installed_is_found_missing(logged: List[str], monkeypatch: Any) -> None:
    monkeypatch.setattr(compiled_codec.importlib.util, 'find_spec', lambda name: None)
    codec = CompiledCodec()
    assert not codec.ready()
    wait(codec)
    assert codec.problem == MISSING and logged == [MISSING]


@pytest.mark.parametrize('error', [OSError('no space left'), ImportError('it is broken', name='llvmlite'),
                                   RuntimeError('no locator available')])
def test_another_failure_is_reported_once(logged: List[str], error: Exception) -> None:
    codec = CompiledCodec(failing(error))
    assert not codec.ready()
    wait(codec)
    assert not codec.ready()
    assert logged == ['layered images and maps in tiles cannot be coded: %s%s' % (error, INSTEAD)] == [codec.problem]


@pytest.mark.parametrize('program, problem', [
    ('import sys; sys.exit(0)', None), ('import sys; sys.exit(3)', 'compiling fails: exit code 3'),
    ('raise ValueError("bad cache")', 'compiling fails: ValueError: bad cache')])
def test_a_child_compiles(program: str, problem: Any, monkeypatch: Any, logged: List[str]) -> None:
    made: List[List[str]] = []
    popen = subprocess.Popen

    def start(command: List[str], **options: Any) -> Any:
        made.append(command)
        return popen([sys.executable, '-c', program], **options)

    class Codec:
        """Stands in for codecs.layered.compile."""
        @staticmethod
        def compiled() -> bool:
            return False

        @staticmethod
        def compile_all() -> None:
            loaded.append(1)
    loaded: List[int] = []
    monkeypatch.setattr(compiled_codec.importlib, 'import_module', lambda name: Codec)
    monkeypatch.setattr(compiled_codec.subprocess, 'Popen', start)
    codec = CompiledCodec()
    assert not codec.ready()
    wait(codec)
    assert made == [[sys.executable, '-m', 'smokebot_udp.codecs.layered.compile']]
    assert codec.ready() == (problem is None) == bool(loaded) and len(logged) == (1 if problem is None else 2)
    assert problem is None or logged[1] == 'layered images and maps in tiles cannot be coded: ' + problem + INSTEAD


def test_a_node_that_ends_kills_the_child(monkeypatch: Any, logged: List[str]) -> None:
    popen, started = subprocess.Popen, threading.Event()
    children: List[Any] = []

    def start(command: List[str], **options: Any) -> Any:
        children.append(popen([sys.executable, '-c', 'import signal; signal.pause()'], **options))
        started.set()
        return children[0]

    class Codec:
        """Stands in for codecs.layered.compile."""
        @staticmethod
        def compiled() -> bool:
            return False
    monkeypatch.setattr(compiled_codec.importlib, 'import_module', lambda name: Codec)
    monkeypatch.setattr(compiled_codec.subprocess, 'Popen', start)
    codec = CompiledCodec()
    assert not codec.ready() and started.wait(WAIT)
    codec.close()
    assert children[0].returncode is not None and len(logged) == 1 and not codec.ready()
