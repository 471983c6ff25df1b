# SPDX-License-Identifier: BSD-3-Clause
"""Importing this module skips the tests of the importing one where PyAV or numba is missing."""
import needs_numba  # noqa: F401
import pytest

pytest.importorskip('av', reason='video needs PyAV: sudo apt install python3-av')
