# SPDX-License-Identifier: BSD-3-Clause
"""Keeps freed memory at hand: a picture's arrays are as large as the last one's, fifty times a second."""
import contextlib
import ctypes

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3     # malloc.h
LARGEST_KEPT = 32 << 20
"""More glibc always gives back at once [byte]."""


def keep_freed():
    """From now on this process keeps what it frees, as much as it ever used: else the kernel zeroes each large array's
    pages anew, which costs a third of the work on a picture. Without glibc nothing happens."""
    with contextlib.suppress(AttributeError, OSError):
        mallopt = ctypes.CDLL(None).mallopt
        mallopt(M_MMAP_THRESHOLD, LARGEST_KEPT)
        mallopt(M_TRIM_THRESHOLD, 8 * LARGEST_KEPT)
