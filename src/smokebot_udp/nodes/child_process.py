# SPDX-License-Identifier: BSD-3-Clause
"""Child processes that end with their parent, and what they leave behind.

The processes of a family inherit a mark from the first one: a variable in their environment. It finds those that have
started sessions of their own, as roslaunch's nodes do, and those whose parents were killed.
"""
import contextlib
import os
import pathlib
import signal
import time
import uuid
from typing import List, Sequence

MARK = 'SMOKEBOT_UDP_FAMILY_'
"""Marks begin with it: a family within a family has two."""

RUN_WITH_PARENT = '[ "$PPID" = "$0" ] && exec "$@"'
"""A shell's script whose $0 is the process id of the parent."""

PERIOD = 0.05
"""How often it is looked whether processes have ended [s]."""


def with_parent(command: Sequence[str], death_signal: str) -> List[str]:
    """A command that gets a signal when the thread that has started it ends, however it ends.

    It does not run where this process ended before it could ask for the signal.

    :param death_signal: its name without SIG
    """
    return ['setpriv', '--pdeathsig', death_signal, 'sh', '-c', RUN_WITH_PARENT, str(os.getpid()), *command]


def new_mark() -> str:
    """The name of a variable, which is to be set to 1 in the environment of the first process of a family."""
    return MARK + uuid.uuid4().hex


def family(mark: str) -> List[int]:
    """The living processes with this mark, those of other users aside."""
    wanted, found = ('%s=1' % mark).encode(), []
    for folder in pathlib.Path('/proc').glob('[0-9]*'):
        with contextlib.suppress(OSError):      # it has ended, or is another user's; a zombie's environment is empty
            if wanted in (folder / 'environ').read_bytes().split(b'\0'):
                found.append(int(folder.name))
    return found


def end_family(mark: str, timeout: float) -> None:
    """End all processes with this mark; return when there is none.

    :param timeout: time after which they are killed [s]
    """
    deadline = time.monotonic() + timeout
    signalled = family(mark)
    _signal(signalled, signal.SIGTERM)
    left = signalled
    while left:
        if time.monotonic() > deadline:
            _signal(left, signal.SIGKILL)
        time.sleep(PERIOD)
        left = family(mark)


def words(code: int) -> str:
    """What an exit code says."""
    return 'exit code %d' % code if code >= 0 else signal.Signals(-code).name


def _signal(pids: Sequence[int], number: int) -> None:
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, number)
