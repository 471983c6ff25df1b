# SPDX-License-Identifier: BSD-3-Clause
"""Tuning of malloc: freed memory stays with the process, because each image needs arrays of the same sizes again.
Memory that was of no use for some seconds returns to the kernel: peaks would add up otherwise, as they leave gaps.

All threads share one arena. glibc would make eight for each core, and what a thread frees in one of them is of no use
to a thread of another: each connection has a thread of its own, so each one that is made anew would add some memory to
another arena. Threads hardly ever wait for the arena, because most of them allocate while they hold Python's lock.
"""
import contextlib
import ctypes

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD, M_ARENA_MAX = -1, -3, -8     # malloc.h
MAX_KEPT_BLOCK = 32 << 20
"""Size of the largest block that is kept. glibc always returns larger blocks to the kernel at once [byte]."""


def keep_freed_memory() -> None:
    """Keep freed memory in this process from now on, up to its peak use, until `return_freed_memory`.

    Otherwise the kernel clears the pages of each large array anew, which takes a third of the work on an image. Without
    glibc this does nothing.
    """
    with contextlib.suppress(AttributeError, OSError):
        mallopt = ctypes.CDLL(None).mallopt
        mallopt(M_MMAP_THRESHOLD, MAX_KEPT_BLOCK)
        mallopt(M_TRIM_THRESHOLD, 8 * MAX_KEPT_BLOCK)
        mallopt(M_ARENA_MAX, 1)


def return_freed_memory() -> None:
    """Return all memory that is free now to the kernel. It takes some ms; without glibc it does nothing."""
    with contextlib.suppress(AttributeError, OSError):
        ctypes.CDLL(None).malloc_trim(0)
