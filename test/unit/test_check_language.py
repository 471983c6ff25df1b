# SPDX-License-Identifier: BSD-3-Clause
import ast
import pathlib
from typing import List

import pytest

from tools.check_language import TOP, docstrings, faults_of, shared_names, words

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


def test_a_word_with_a_better_one_is_found_in_names_and_prose() -> None:
    word = 'pati' + 'ence'
    lines = ['MAX_%s = 1' % word.upper(), 'im%s' % word, '# %s of a client' % word.capitalize(), 'a_%s_b = 2' % word]
    assert [found.line for found in words(pathlib.Path('some.py'), '\n'.join(lines))] == [1, 3, 4]


def test_two_modules_of_a_folder_share_no_class_name() -> None:
    one, two, other, test = (TOP / place for place in ('src/a/one.py', 'src/a/two.py', 'src/b/one.py', 'test/two.py'))
    tree = ast.parse('class Limits: pass')
    assert [(found.path, found.line) for found in shared_names({one: tree, two: tree, other: tree, test: tree})] == [
        (two, 1)]
