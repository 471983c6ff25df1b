# SPDX-License-Identifier: BSD-3-Clause
"""Loads the fuzzers of test/fuzz, for tests with a limited number of inputs."""
import importlib.util
import pathlib
from random import Random
from typing import Any

FOLDER = pathlib.Path(__file__).resolve().parents[1] / 'fuzz'


def fuzzer(name: str) -> Any:
    """The Fuzzer of a file, always with the same seed."""
    spec = importlib.util.spec_from_file_location(name, str(FOLDER / (name + '.py')))
    assert spec is not None and spec.loader is not None
    module: Any = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.Fuzzer(Random(5))
