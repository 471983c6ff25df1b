# SPDX-License-Identifier: BSD-3-Clause
import ast
from typing import List

import pytest

from tools.check_language import docstrings, faults_of

MODULE = '''
"""A module."""
FIRST = 1
"""Of a constant"""
class Some:
    """A class."""
    field: int = 0
    """[s]"""
    def method(self):
        """Do it."""
        if self.field:
            'no docstring: but it is checked, too'
        return lambda: 'text'
'''


def test_all_docstrings_are_found() -> None:
    assert sorted(docstrings(ast.parse(MODULE))) == [
        (2, 'A module.'), (4, 'Of a constant'), (6, 'A class.'), (8, '[s]'), (10, 'Do it.'),
        (12, 'no docstring: but it is checked, too')]


@pytest.mark.parametrize('text, faults', [
    ('The duration of a job [s].', []), ('Of a job [s].', ['begins with "Of"']), ('Offset of a clock [s].', []),
    ('the first,', ['begins in lower case', "ends with ','"]), ('Bytes, the first;', ["ends with ';'"]),
    ('f(x) -> y', []), ('np.ndarray of bytes', []), ('{name: value}', []), ('[s]', []), ('0..1', [])])
def test_what_does_not_stand_alone(text: str, faults: List[str]) -> None:
    assert list(faults_of(text)) == faults
