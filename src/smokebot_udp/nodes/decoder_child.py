# SPDX-License-Identifier: BSD-3-Clause
"""One process that decodes video (codecs/video/decoder_process.py), as its node sees it: it may die, hang or lie.

It is executed anew and inherits two pipes and a sealed memory. Neither can it make the memory shorter under the node's
feet, nor can a full pipe block the node.
"""
import fcntl
import mmap
import os
import pathlib
import select
import subprocess
import sys
import time
from typing import Sequence

from ..codecs.video import nal
from ..codecs.video.decoder_memory import ANSWER, PLANES_AT, SIZE, Answer, Command, Status
from ..codecs.video.decoder_request import Request
from .child_process import with_parent, words

PROGRAM = sys.executable, '-m', 'smokebot_udp.codecs.video.decoder_process'
"""Its argument is the number of the memory's file descriptor."""

PASSED_ON = 'PATH', 'LD_LIBRARY_PATH', 'LANG', 'LC_ALL', 'TZ'
"""Variables of the environment; others, which may hold a key, are not."""

MAX_STARVED = 30.0
"""A process that waits for the processor, as others have it, is given so many times as long."""

END_TIMEOUT = 0.1
"""For a process to end that has closed its pipe [s]."""

BROKEN = 'decoder broken'
"""Reason why the process never runs."""

CPUCLOCK_SCHED = 2
"""With the number of a process, which is inverted, it makes the number of its clock, see clock_getcpuclockid(3)."""


class ChildError(Exception):
    """The process cannot be used any more.

    :param reason: in short, for counting
    :param text: what is known beside the reason
    """

    def __init__(self, reason: str, text: str) -> None:
        super().__init__('%s: %s' % (reason, text))
        self.reason = reason


class DecoderChild:
    """Starts the process. The kernel kills it when the thread that made this object ends.

    All but `kill` belongs to one thread.

    :raises OSError: it cannot be started
    """

    def __init__(self, program: Sequence[str] = PROGRAM) -> None:
        self.started = time.monotonic()
        self._number = 0
        self._is_ready = False
        memory = os.memfd_create('video', os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
        try:
            os.ftruncate(memory, SIZE)
            fcntl.fcntl(memory, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL)
            self.memory = memoryview(mmap.mmap(memory, SIZE))
            environment = {name: os.environ[name] for name in PASSED_ON if name in os.environ}
            environment['PYTHONPATH'] = os.pathsep.join(os.path.abspath(path) for path in sys.path)
            self._process = subprocess.Popen(
                with_parent([*program, str(memory)], 'KILL'), env=environment, cwd='/',
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0,
                pass_fds=[memory], start_new_session=True)
        finally:
            os.close(memory)
        assert self._process.stdin is not None and self._process.stdout is not None
        self._commands, self._answers = self._process.stdin, self._process.stdout
        self.pid = self._process.pid

    def await_ready(self, timeout: float) -> None:
        """Return when it can decode.

        :param timeout: after the start [s]
        :raises ChildError: it cannot
        """
        if self._is_ready:
            return
        answer = self._answer(self.started, timeout)
        if answer.status == Status.BROKEN:
            text = bytes(self.memory[PLANES_AT:PLANES_AT + 256]).split(b'\0')[0]
            raise ChildError(BROKEN, text.decode(errors='replace'))
        if answer.status != Status.READY or answer.number:
            raise ChildError('decoder nonsense', 'it begins with %r' % (answer,))
        self._is_ready = True

    def decode(self, request: Request, timeout: float) -> Answer:
        """Decode an image; its planes are in the memory until the next one.

        :param request: checked
        :param timeout: [s]
        :return: with Status.DECODED, NOTHING or UNFIT
        :raises ChildError: it cannot
        """
        slices = nal.byte_stream(request.slices)
        size = len(request.parameter_sets)
        self.memory[:size] = request.parameter_sets
        self.memory[size:size + len(slices)] = slices
        self._number = (self._number + 1) & 0xffffffff
        begun = time.monotonic()
        try:
            self._commands.write(Command(self._number, request.session, request.height, request.width, size,
                                         len(slices), request.colour).to_bytes())
        except (BrokenPipeError, ValueError):
            raise self._died() from None
        answer = self._answer(begun, timeout)
        if answer.number != self._number or answer.status not in (Status.DECODED, Status.NOTHING, Status.UNFIT):
            raise ChildError('decoder nonsense', 'it answers %r' % (answer,))
        return answer

    def kill(self) -> None:
        """Kill the process, from any thread: the other methods end then."""
        self._process.kill()

    def close(self) -> None:
        """Kill the process, and close its pipes."""
        self._process.kill()
        self._process.wait()
        self._commands.close()
        self._answers.close()

    def _answer(self, begun: float, timeout: float) -> Answer:
        """The next record, `timeout` after `begun` at the latest; later where the process waits for the processor."""
        poll = select.poll()
        poll.register(self._answers, select.POLLIN)
        used, limit = self._used(), timeout
        while not poll.poll(max(0.0, 1e3 * (begun + limit - time.monotonic()))):
            limit += timeout
            hangs = not self._waits() or self._used() - used > timeout or limit > MAX_STARVED * timeout
            if hangs and not poll.poll(0):      # it may wait because it has just answered
                raise ChildError('decoder hung', 'no answer in time')
        data = self._answers.read(ANSWER.size) or b''
        if not data:
            raise self._died()
        try:
            return Answer.from_bytes(data)
        except ValueError as error:
            raise ChildError('decoder nonsense', str(error)) from None

    def _died(self) -> ChildError:
        """After the end of its pipe: it has ended, or closed the pipe only."""
        try:
            code = self._process.wait(END_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            code = self._process.wait()
        return ChildError('decoder died', words(code))

    def _waits(self) -> bool:
        """Whether it runs, or waits for the processor or a disk: not for something else, and is not stopped."""
        try:
            stat = pathlib.Path('/proc/%d/stat' % self.pid).read_text()
        except OSError:
            return False
        return stat.rpartition(')')[2].split()[0] in 'RD'

    def _used(self) -> float:
        """Processor time [s]."""
        try:
            return time.clock_gettime(~self.pid << 3 | CPUCLOCK_SCHED)
        except OSError:     # it has ended
            return 0.0
