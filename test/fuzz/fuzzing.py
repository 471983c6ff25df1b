# SPDX-License-Identifier: BSD-3-Clause
"""What the fuzzers have in common: they run until enough inputs were tried, and report."""
import resource
from typing import Any


def memory() -> int:
    """The largest memory of the process so far [MiB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024


def run(fuzzer: Any, inputs: int, max_time: float) -> int:
    """Feed batches; the exit status: 1: a batch took too long. Any exception is a fault.

    :param fuzzer: has good() and batch(), and `inputs`, `worst` [s], and report()
    :param max_time: longest processor time of a batch [s]
    """
    fuzzer.good()
    before, reported, fuzzer.worst = memory(), 0, 0.0
    while fuzzer.inputs < inputs:
        fuzzer.batch()
        if fuzzer.inputs >= reported:
            reported += max(inputs // 20, 1)
            fuzzer.good()
            print('%d inputs, longest batch %.3f s, memory + %d MiB; %s' % (
                fuzzer.inputs, fuzzer.worst, memory() - before, fuzzer.report()), flush=True)
    fuzzer.good()
    return int(fuzzer.worst > max_time)
