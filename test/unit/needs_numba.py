# SPDX-License-Identifier: BSD-3-Clause
"""Importing this module skips the tests of the importing one where numba is missing."""
import pytest

pytest.importorskip('numba', reason='layered images and maps in tiles need numba: sudo apt install python3-numba')
