# SPDX-License-Identifier: BSD-3-Clause
import fcntl
import os
import pathlib
import shutil
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

pytest.importorskip('numba')

try:
    from numba.core.dispatcher import _DispatcherBase
    from numba.core.runtime import rtsys
except ImportError:     # numba 0.48
    from numba.dispatcher import _DispatcherBase
    from numba.runtime import rtsys

from smokebot_udp.arrays import Array  # noqa: E402
from smokebot_udp.codecs.layered import cache, image  # noqa: E402
from smokebot_udp.codecs.layered.loops import compiled  # noqa: E402
from smokebot_udp.codecs.layered.range_coder import begin  # noqa: E402


@compiled
def element(x: Array, i: int) -> int:
    return int(x[i])


def test_indexes_out_of_range_are_found_in_these_tests() -> None:
    assert element(np.array([5, 6]), 1) == 6
    with pytest.raises(IndexError):
        element(np.array([5, 6]), 2)


def test_loops_free_what_they_allocate() -> None:
    # functions that do not count references must not make arrays, nor call those that do
    from smokebot_udp.codecs.layered import motion
    image_, other = (np.random.RandomState(1).randint(0, 256, (61, 83)).astype(np.uint8).repeat(2, 0)[:64, k:k + 70]
                     for k in (0, 1))
    moved = motion.Motion(np.full((5, 5, 2), 40, np.int16), True)

    def work() -> None:
        stream = image.encode(image_, False, 2000, None, motion.compensate(other, moved))
        motion.estimate(other, image_)
        stream.prefixes.pixels(1000)
        image.decode(stream.data, *image_.shape, 1, 1, motion.compensate(other, moved))
    work()
    before = rtsys.get_allocation_stats()
    for _ in range(3):
        work()
    after = rtsys.get_allocation_stats()
    assert after.alloc - before.alloc > 10 and after.alloc - after.free == before.alloc - before.free


def sources(folder: pathlib.Path, monkeypatch: Any) -> pathlib.Path:
    """A source that stands for all, and a cache of its own."""
    folder.mkdir()
    monkeypatch.setattr(cache, 'FOLDER', folder)
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(folder / 'told'))
    source = folder / 'passes.py'
    source.write_text('# old')
    return source


@pytest.mark.parametrize('clock', ['right', 'back', 'the same'])
def test_what_was_compiled_from_other_sources_is_removed_whatever_the_times_say(clock: str, tmp_path, monkeypatch
                                                                                ) -> None:
    source = sources(tmp_path / 'layered', monkeypatch)
    before = source.stat().st_mtime_ns
    cache.remember()
    folder = cache.cache_folder()
    index = folder / 'passes.old.nbi'
    index.touch()
    cache.remove_stale()
    assert index.exists() and cache.compiled()
    source.write_text('# new')
    times = {'right': before + 10 ** 9, 'back': before - 10 ** 12, 'the same': before}
    os.utime(source, ns=(times[clock], times[clock]))
    assert not cache.compiled()
    cache.remove_stale()
    assert not index.exists() and not cache.compiled()
    index.touch()           # compiled from the new source
    cache.remove_stale()
    assert index.exists()


def test_a_stamp_says_that_the_cache_is_filled_for_this_machine(tmp_path, monkeypatch) -> None:
    sources(tmp_path / 'layered', monkeypatch)
    assert not cache.compiled()
    cache.remember()
    assert cache.compiled()
    with monkeypatch.context() as changed:
        changed.setenv('NUMBA_BOUNDSCHECK', '0')
        assert not cache.compiled()
    with monkeypatch.context() as changed:
        changed.setattr(cache.platform, 'machine', lambda: 'another')
        assert not cache.compiled()
    text = 'processor : 0\nmodel name : %s\ncpu MHz : %d\nflags : fpu %s\n\nprocessor : 1\n'
    monkeypatch.setattr(cache, 'CPU_INFO', tmp_path / 'cpuinfo')
    for filled, processor in ((False, ('A', 1000, 'avx2')), (True, ('A', 2000, 'avx2')), (False, ('B', 2000, 'avx2')),
                              (False, ('A', 2000, 'avx2 avx512f')), (True, ('A', 2000, 'avx2'))):
        cache.CPU_INFO.write_text(text % processor)
        assert cache.compiled() == filled
        cache.remember()        # a home folder may be shared by machines
    (cache.cache_folder() / cache.STAMP).unlink()
    assert not cache.compiled()


def test_the_folder_is_the_one_that_numba_uses(tmp_path) -> None:
    assert str(cache.cache_folder()) == begin.stats.cache_path
    # sources that this user cannot write beside
    package = tmp_path / 'smokebot_udp'
    shutil.copytree(str(cache.FOLDER.parents[1]), str(package), ignore=shutil.ignore_patterns('__pycache__'))
    (package / 'codecs' / 'layered' / '__pycache__').touch()
    program = ('from smokebot_udp.codecs.layered import cache, range_coder; cache.remember(); '
               'print(cache.cache_folder(), range_coder.begin.stats.cache_path, cache.compiled())')
    environment = {**os.environ, 'PYTHONPATH': str(tmp_path), 'XDG_CACHE_HOME': str(tmp_path / 'home')}
    del environment['NUMBA_CACHE_DIR']
    said = subprocess.run([sys.executable, '-B', '-c', program], env=environment, stdout=subprocess.PIPE, check=True)
    folder, numbas, filled = said.stdout.decode().split()
    assert folder == numbas and folder.startswith(str(tmp_path / 'home')) and filled == 'True'


def test_on_a_read_only_disk_the_folder_is_a_temporary_one_of_this_user_alone(tmp_path) -> None:
    package, file, temporary = tmp_path / 'smokebot_udp', tmp_path / 'file', tmp_path / 'tmp'
    shutil.copytree(str(cache.FOLDER.parents[1]), str(package), ignore=shutil.ignore_patterns('__pycache__'))
    for name in 'layered', 'tiles':
        (package / 'codecs' / name / '__pycache__').touch()
    file.touch()
    temporary.mkdir()
    program = ('from smokebot_udp.codecs.layered import cache, range_coder; '
               'from smokebot_udp.codecs.tiles import cells; cache.remember(); '
               'print(cache.cache_folder(), range_coder.begin.stats.cache_path, cache.compiled(), '
               'cells.decode_cells.stats.cache_path)')
    environment = {**os.environ, 'PYTHONPATH': str(tmp_path), 'XDG_CACHE_HOME': str(file), 'HOME': str(file),
                   'TMPDIR': str(temporary)}
    del environment['NUMBA_CACHE_DIR']

    def said() -> Any:
        done = subprocess.run([sys.executable, '-B', '-c', program], env=environment, capture_output=True)
        return done.stdout.decode().split() or done.stderr.decode()
    folder, numbas, filled, tiles = said()
    own = temporary / ('smokebot_udp_%d' % os.getuid())
    assert folder == numbas and filled == 'True' and {str(pathlib.Path(one).parent) for one in (folder, tiles)} == {
        str(own)}
    assert own.stat().st_mode & 0o777 == 0o700
    own.chmod(0o777)        # others may have written there
    assert 'cannot cache function' in said()


def test_where_no_folder_can_be_written_nothing_is_compiled_ahead(tmp_path, monkeypatch) -> None:
    sources(tmp_path / 'layered', monkeypatch)
    monkeypatch.setattr(cache.tempfile, 'tempdir', str(tmp_path / 'file'))
    (tmp_path / 'file').touch()
    (tmp_path / 'layered' / '__pycache__').touch()
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tmp_path / 'file'))
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'file'))
    cache.remember()
    assert cache.cache_folder() is None and not cache.compiled()


def test_one_process_compiles_at_a_time(tmp_path, monkeypatch) -> None:
    sources(tmp_path / 'layered', monkeypatch)
    with cache.locked(), open(str(cache.cache_folder() / cache.LOCK)) as lock, pytest.raises(BlockingIOError):
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    with open(str(cache.cache_folder() / cache.LOCK)) as lock:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)


def test_real_images_compile_nothing_more() -> None:
    """Their pixels are views of messages, read-only and anywhere."""
    program = """
import numpy as np
from smokebot_udp.codecs.layered import alignment, class_map, coefficients, colour, compile, depth
from smokebot_udp.codecs.layered import blend, image, motion, passes, prediction, prefixes, range_coder, warp
from smokebot_udp.codecs.layered import noise_choice, shrinking, wavelet
compile.compile_all()
def compiled():
    return {(name, str(signature)) for module in (alignment, blend, class_map, coefficients, colour, depth,
                                                  noise_choice, passes, prediction, prefixes, range_coder, shrinking,
                                                  warp, wavelet)
            for name, loop in vars(module).items() for signature in getattr(loop, 'signatures', ())}
before = compiled()
for kind, channels, offset in (('uint8', 1, 1), ('uint16', 1, 1), ('uint8', 3, 0)):
    pixels = np.frombuffer(bytes(offset + 60 * 90 * channels * 2), np.uint8)[offset:].view(kind)[:60 * 90 * channels]
    pixels = pixels.reshape((60, 90, 3) if channels == 3 else (60, 90))
    assert not pixels.flags.writeable
    motion.compensate(pixels, motion.Motion(np.zeros((5, 5, 2), np.int16), True))
    motion.estimate(pixels, pixels)
    blend.blended(pixels, pixels, blend.share_of(pixels, pixels, pixels))
    for lossless in (False, True):
        for classes in (None, np.frombuffer(bytes(60 * 90), np.uint8).reshape(60, 90)):
            for reference in (None, pixels):
                stream = image.encode(pixels, lossless, 9999, classes, reference)
                image.decode(memoryview(stream.data), 60, 90, channels, pixels.itemsize, reference)
                stream.prefixes.pixels(999)
metres = np.frombuffer(np.array([[1.0, np.nan]], np.float32).tobytes(), np.float32).reshape(1, 2)
depth.to_counts(metres, 0.1)
print(len(before), compiled() - before)
"""
    said = subprocess.run([sys.executable, '-c', program], stdout=subprocess.PIPE, check=True).stdout.decode()
    number, added = said.split(' ', 1)
    assert int(number) > 30 and added.strip() == 'set()'


def test_asking_whether_the_cache_is_filled_does_not_import_numba() -> None:
    program = ('import sys; from smokebot_udp.codecs.layered.compile import compiled; compiled(); '
               'sys.exit("numba" in sys.modules)')
    assert subprocess.run([sys.executable, '-c', program]).returncode == 0


def test_numba_knows_the_types_of_all_arguments_from_before(monkeypatch: Any) -> None:
    """What numba types anew at each call it keeps for ever: long tuples of arrays, in numba 0.56."""
    pixels = np.random.RandomState(0).randint(2000, 4000, (60, 80)).astype(np.uint16)
    reference, typed = pixels // 2, []
    known = _DispatcherBase.typeof_pyval

    def typeof(self: Any, value: Any) -> Any:
        typed.append((self, type(value)))
        return known(self, value)

    def work() -> None:
        for before in (None, reference):
            stream = image.encode(pixels, False, 3000, reference=before)
            assert image.decode(stream.data, 60, 80, 1, 2, before) is not None
    work()
    monkeypatch.setattr(_DispatcherBase, 'typeof_pyval', typeof)
    for _ in range(5):
        work()
    assert not typed
