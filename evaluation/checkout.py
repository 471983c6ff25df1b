# SPDX-License-Identifier: BSD-3-Clause
"""The state of this checkout, so that a number can be traced to the code that it was measured with."""
import subprocess
from typing import NamedTuple, Optional

from . import TOP

CODE = '.', ':!doc', ':!*.md', ':!CHANGELOG.rst'
"""Paths that a measurement depends on: a change of the documents is no other state."""


class State(NamedTuple):
    """The state of the code."""
    commit: Optional[str]
    """The last commit that changed more than documents, abbreviated; None: this is no checkout."""
    dirty: bool
    """Whether there are changes since that commit."""


def state() -> State:
    """The state of the code now."""
    commit = _git('log', '-1', '--abbrev=10', '--format=%h', '--', *CODE)
    return State(commit or None, bool(commit and _git('status', '--porcelain', '--', *CODE)))


def _git(*arguments: str) -> str:
    """What a git command says; empty where it cannot."""
    try:
        return subprocess.run(['git', '-C', str(TOP), *arguments], stdout=subprocess.PIPE,
                              stderr=subprocess.DEVNULL).stdout.decode().strip()
    except FileNotFoundError:
        return ''
