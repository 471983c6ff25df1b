# SPDX-License-Identifier: BSD-3-Clause
"""Loads the codec of layered images and of maps in tiles, whose loops are compiled by numba, and with it those of
clouds: in the background, when it is first needed.

Loading takes a second, and 100 MB that a node without them saves. Where the loops are not compiled yet for
this machine, which takes up to a minute, a child process fills numba's cache: in this one the compiler would hold the
interpreter's lock and delay everything else.
"""
import importlib
import importlib.util
import subprocess
import sys
import threading
from typing import Callable, Optional

import rospy

PACKAGE = 'smokebot_udp.codecs.layered'

COMPILE_TIMEOUT = 600.0
"""A child that compiles for longer is ended [s]."""

CODED = 'layered images and maps in tiles'
INSTEAD = '. Until then images and maps cross interleaved, and clouds need PCL or are filtered slower'
MISSING = CODED + (' cannot be coded: numba is missing. Install python3-numba (sudo apt install python3-numba) '
                   'and restart this node') + INSTEAD


class CompiledCodec:
    """Whether the compiled codec is loaded. Any thread may ask.

    :param load: f(compiling), compiles and imports it, and calls `compiling` before it compiles; raises ImportError or
        another Exception where that fails. It runs in a thread of its own
    """

    def __init__(self, load: Optional[Callable[[Callable[[], None]], None]] = None) -> None:
        self._child: Optional[subprocess.Popen[bytes]] = None
        self._load = load or self._compile_and_import
        self._lock = threading.Lock()
        self._thread: Optional[threading.Thread] = None
        self._ready = self._closed = False
        self.problem: Optional[str] = None
        """Why it is not loaded yet, or cannot be, in words; None: it is loaded or was not needed."""

    def ready(self) -> bool:
        """Whether it is loaded; loading begins with the first call."""
        if not self._ready and self._thread is None:
            with self._lock:
                if self._thread is None and not self._closed:
                    self.problem = CODED + ' wait: their codec is being loaded'
                    self._thread = threading.Thread(target=self._run, name='codec', daemon=True)
                    self._thread.start()
        return self._ready

    def close(self) -> None:
        """Give up loading."""
        with self._lock:
            self._closed = True
            if self._child is not None:
                self._child.kill()
        if self._thread is not None:
            self._thread.join()

    def _run(self) -> None:
        try:
            self._load(self._compiling)
        except Exception as error:      # numba's are many, such as RuntimeError where no folder can be the cache
            if not self._closed:
                self.problem = MISSING if isinstance(error, ImportError) and error.name == 'numba' else (
                    '%s cannot be coded: %s%s' % (CODED, error, INSTEAD))
                rospy.logerr('%s', self.problem)
        else:
            self.problem, self._ready = None, True

    def _compiling(self) -> None:
        self.problem = CODED + ' wait: their codec is being compiled, once on this machine'
        rospy.logwarn('%s. It takes up to a minute', self.problem)

    def _compile_and_import(self, compiling: Callable[[], None]) -> None:
        if importlib.util.find_spec('numba') is None:
            raise ImportError('No module named numba', name='numba')
        compile_module = importlib.import_module(PACKAGE + '.compile')
        if not compile_module.compiled():
            compiling()
            self._compile()
        compile_module.compile_all()    # from the cache: the first images do not wait for it

    def _compile(self) -> None:
        """Fill numba's cache.

        :raises OSError: it fails
        """
        with self._lock:
            if self._closed:
                raise OSError('the node ends')
            self._child = subprocess.Popen([sys.executable, '-m', PACKAGE + '.compile'], stdin=subprocess.DEVNULL,
                                           stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        try:
            _, errors = self._child.communicate(timeout=COMPILE_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.communicate()
            raise OSError('compiling takes more than %g s' % COMPILE_TIMEOUT) from None
        if self._child.returncode:
            lines = errors.decode(errors='replace').strip().splitlines()
            raise OSError('compiling fails: %s' % (lines[-1] if lines else 'exit code %d' % self._child.returncode))
