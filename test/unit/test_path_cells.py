# SPDX-License-Identifier: BSD-3-Clause
import pathlib
from typing import Any, List

import pytest

from evaluation import path_cells
from evaluation.path_cells import CASES, FIRST, SECOND, TBF


def test_cases_have_names_of_their_own() -> None:
    assert len({case.name for case in CASES}) == len(CASES)


def test_a_kernels_shaper_has_both_links_and_each_of_them() -> None:
    found = {case.name: case.links for case in CASES if case.shaper == TBF and not case.jpeg}
    assert found['tbf, 0 %: both'] == (FIRST, SECOND)
    assert found['tbf, 5 %: the second'] == ({**SECOND, 'loss': 0.05},)
    assert len(found) == 6


def test_multipath_tcp_has_both_links_and_is_lost_only_by_the_link_lab() -> None:
    cases = [case for case in CASES if case.jpeg]
    assert {len(case.links) for case in cases} == {2}
    assert {link['loss'] for case in cases for link in case.links} == {0.0, 0.05}
    assert not any(link['loss'] for case in cases if case.shaper for link in case.links)


def test_a_case_that_cannot_run_says_so_in_a_line_and_is_left_out(monkeypatch: pytest.MonkeyPatch,
                                                                         tmp_path: pathlib.Path) -> None:
    def refuse(case: Any, seed: int) -> Any:
        raise RuntimeError('the kernel has no multipath TCP')
    monkeypatch.setattr(path_cells, 'links_of', refuse)
    said: List[str] = []
    assert list(path_cells.measured(CASES[0], 1.0, 0, said.append, tmp_path)) == []
    assert said == ['0 %: both: the kernel has no multipath TCP']
