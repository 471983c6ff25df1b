# SPDX-License-Identifier: BSD-3-Clause
"""Where numba keeps the compiled loops, whether all are there, and which are out of date; without importing numba."""
import contextlib
import fcntl
import hashlib
import os
import pathlib
import platform
import stat
import sys
import sysconfig
import tempfile
from typing import Iterator, List, Optional

FOLDER = pathlib.Path(os.path.abspath(__file__)).parent
OTHERS = ('tiles', 'perception')
"""Packages beside this one with loops, which are compiled with these."""
STAMP = 'loops.nbs'
"""A file beside the cache: the key of the sources; then, a line each, the keys of the machines that all loops were
compiled for from them."""
LOCK = 'loops.lock'
"""A file beside the cache: who compiles all loops locks it."""

CPU_INFO = pathlib.Path('/proc/cpuinfo')
_CPU = ('vendor_id', 'cpu family', 'model', 'model name', 'flags', 'CPU implementer', 'CPU variant', 'CPU part',
        'Features')
"""Fields of CPU_INFO that decide what code is compiled for. numba asks LLVM, which takes an import."""


def cache_folder(package: Optional[pathlib.Path] = None) -> Optional[pathlib.Path]:
    """The folder where numba keeps the compiled loops of a package (None: this one), which is made.

    It is the first that can be written into of NUMBA_CACHE_DIR, the folder beside the sources, the user's cache, and
    `temporary_folder`, as on a robot whose disk is read-only; None: there is none.
    """
    package = package or FOLDER
    name = '%s_%s' % (package.name, hashlib.sha1(str(package).encode()).hexdigest())
    user = os.environ.get('XDG_CACHE_HOME', os.path.expanduser('~/.cache'))
    folders = [package / '__pycache__', pathlib.Path(user, 'numba', name)]
    told = os.environ.get('NUMBA_CACHE_DIR')
    if told:
        folders.insert(0, pathlib.Path(told, name))
    found = next(filter(_can_be_written, folders), None)
    if found is None:
        temporary = temporary_folder()
        found = temporary / name if temporary is not None and _can_be_written(temporary / name) else None
    return found


def told_folder() -> Optional[str]:
    """What numba has to be told as NUMBA_CACHE_DIR; None: it finds `cache_folder` itself, or there is none."""
    folder = cache_folder()
    return str(folder.parent) if folder is not None and folder.parent == temporary_folder() else None


def temporary_folder() -> Optional[pathlib.Path]:
    """This user's folder for files that need not outlive the machine's next start, which is made; None: there is none.

    Nobody else may write into it: machine code is loaded from it.
    """
    folder = pathlib.Path(tempfile.gettempdir(), 'smokebot_udp_%d' % os.getuid())
    with contextlib.suppress(OSError):
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
        if stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and not status.st_mode & 0o077:
            return folder
    return None


def _can_be_written(folder: pathlib.Path) -> bool:
    """Whether files can be made in a folder, which is made."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=str(folder)).close()
    except OSError:
        return False
    return True


def remove_stale() -> None:
    """Remove what was compiled from other sources.

    numba compares the time and size of a function's own file only: others' old loops, compiled into it, would stay.
    """
    folder, sources = cache_folder(), _sources()
    if folder is None or _noted(folder)[:1] == [sources]:
        return
    for package in _packages():
        for index in (cache_folder(package) or folder).glob('*.nbi'):
            with contextlib.suppress(OSError):
                index.unlink()
    _note(folder, [sources])


def compiled() -> bool:
    """Whether all loops are in numba's cache, for these sources, this Python, numba and processor."""
    folder = cache_folder()
    if folder is None:
        return False
    sources, *machines = _noted(folder) or ['']
    return sources == _sources() and _machine() in machines


def remember() -> None:
    """Note that all loops were compiled."""
    folder = cache_folder()
    if folder is not None:
        noted, machine = _noted(folder), _machine()
        others = [other for other in noted[1:] if other != machine] if noted[:1] == [_sources()] else []
        _note(folder, [_sources(), *others, machine])


@contextlib.contextmanager
def locked() -> Iterator[None]:
    """While all loops are compiled: one process at a time, as each takes a minute of a core."""
    folder = cache_folder()
    with contextlib.ExitStack() as stack:
        if folder is not None:
            with contextlib.suppress(OSError):      # another's file, or a file system without locks
                fcntl.flock(stack.enter_context(open(str(folder / LOCK), 'a')), fcntl.LOCK_EX)
        yield


def _noted(folder: pathlib.Path) -> List[str]:
    try:
        return (folder / STAMP).read_text(errors='replace').split()
    except OSError:
        return []


def _note(folder: pathlib.Path, lines: List[str]) -> None:
    """In one step, also where another user's file is there."""
    with contextlib.suppress(OSError):
        with tempfile.NamedTemporaryFile('w', dir=str(folder), prefix=STAMP, delete=False) as file:
            file.write('\n'.join(lines))
        os.chmod(file.name, 0o644)
        os.replace(file.name, str(folder / STAMP))


def _packages() -> List[pathlib.Path]:
    return [FOLDER] + [FOLDER.parent / name for name in OTHERS if (FOLDER.parent / name).is_dir()]


def _sources() -> str:
    """The key of the sources: numba goes by their times, which a wrong clock or a copy may keep or turn back."""
    digest = hashlib.sha256()
    for path in sorted(path for package in _packages() for path in package.glob('*.py')):
        status = path.stat()
        digest.update(('%s %s %d %d\n' % (path.parent.name, path.name, status.st_mtime_ns, status.st_size)).encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _machine() -> str:
    """The key of what compiles the sources, and for what."""
    options = ['%s=%s' % item for item in sorted(os.environ.items())
               if item[0].startswith('NUMBA_') and item[0] != 'NUMBA_CACHE_DIR']
    parts = [sys.version, sysconfig.get_platform(), platform.machine(), str(_numba()), *_processor(), *options]
    return hashlib.sha256('\n'.join(parts).encode()).hexdigest()


def _numba() -> Optional[str]:
    """What tells the installed numba from others, without its import; None: there is none."""
    for folder in sys.path:
        version = pathlib.Path(folder or '.', 'numba', '_version.py')
        if version.is_file():
            return hashlib.sha256(version.read_bytes()).hexdigest()
    return None


def _processor() -> List[str]:
    """Name and features of the first processor."""
    try:
        first = CPU_INFO.read_text(errors='replace').split('\n\n')[0]
    except OSError:
        return []
    return [line for line in first.splitlines() if line.partition(':')[0].strip() in _CPU]
