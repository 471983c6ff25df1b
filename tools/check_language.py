#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Checks docstrings and names: `check_language.py [FILE or FOLDER ...]`, without any: of all Python files.

help() and an editor's hover show the docstring of a module, class, function, constant or field alone. So it stands
alone: it does not begin with "Of" or in lower case, and does not end with a comma or semicolon.

Words for which there is a standard term are in FORBIDDEN. In the package itself no two modules of one folder have
classes of the same name.
"""
import argparse
import ast
import collections
import pathlib
import re
import sys
from typing import DefaultDict, Iterator, List, Mapping, NamedTuple, Tuple

TOP = pathlib.Path(__file__).resolve().parent.parent
FOLDERS = 'src', 'scripts', 'test', 'tools', 'benchmarks', 'experiments', 'evaluation'

FORBIDDEN = {word: re.compile(r'(?i)(?<![a-z])%s(?![a-z])' % word) for word in ('patience', 'taste')}
"""{word: how it is found in names and prose}; timeout and degradation_preference are the standard terms."""

LOWER = re.compile(r'[a-z]+(?:[ ,;:\n]|\.?(?:\s|$))')
"""A word in lower case at the beginning. A name with digits, dots, underscores or brackets may stand there."""


class Found(NamedTuple):
    """Something to mend."""
    path: pathlib.Path
    line: int
    text: str

    def __str__(self) -> str:
        path = self.path.relative_to(TOP) if TOP in self.path.parents else self.path
        return '%s:%d: %s' % (path, self.line, self.text)


def docstrings(tree: ast.AST) -> Iterator[Tuple[int, str]]:
    """(line, text) of the docstrings in a module: its own, those of classes, functions, constants and fields."""
    for node in ast.walk(tree):
        body = getattr(node, 'body', None)      # that of a lambda is no list
        for statement in body if isinstance(body, list) else ():
            if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant) and isinstance(
                    statement.value.value, str):
                yield statement.lineno, statement.value.value


def faults_of(text: str) -> Iterator[str]:
    """What is wrong with a docstring."""
    first = text.strip()
    if first.startswith('Of '):
        yield 'begins with "Of"'
    if LOWER.match(first):
        yield 'begins in lower case'
    if first.endswith((',', ';')):
        yield 'ends with %r' % first[-1]


def docstring_faults(path: pathlib.Path, tree: ast.AST) -> Iterator[Found]:
    """The docstrings that do not stand alone."""
    for line, text in docstrings(tree):
        for fault in faults_of(text):
            yield Found(path, line, 'the docstring %r %s' % (text.strip()[:50], fault))


def words(path: pathlib.Path, text: str) -> Iterator[Found]:
    """The words of a file for which there is a better one."""
    for number, line in enumerate(text.splitlines(), 1):
        for word, pattern in FORBIDDEN.items():
            if pattern.search(line):
                yield Found(path, number, 'the word %r' % word)


def shared_names(trees: Mapping[pathlib.Path, ast.Module]) -> Iterator[Found]:
    """The classes of the package whose names another module of the same folder has, too."""
    found: DefaultDict[Tuple[pathlib.Path, str], List[Tuple[pathlib.Path, int]]] = collections.defaultdict(list)
    for path, tree in trees.items():
        if TOP / 'src' in path.parents:
            for statement in tree.body:
                if isinstance(statement, ast.ClassDef):
                    found[path.parent, statement.name].append((path, statement.lineno))
    for (_, name), places in found.items():
        for path, line in places[1:]:
            yield Found(path, line, 'the class %s is in %s, too' % (name, places[0][0].name))


def check(paths: List[pathlib.Path]) -> List[Found]:
    """What is to be mended in these files."""
    texts = {path: path.read_text(encoding='utf-8') for path in paths}
    trees = {path: ast.parse(text, str(path)) for path, text in texts.items()}
    faults = [fault for path, tree in trees.items() for fault in docstring_faults(path, tree)]
    faults += [fault for path, text in texts.items() if path != pathlib.Path(__file__).resolve()
               for fault in words(path, text)]
    return faults + list(shared_names(trees))


def main() -> int:
    parser = argparse.ArgumentParser(description='Check that docstrings stand alone.')
    parser.add_argument('places', nargs='*', type=lambda text: pathlib.Path(text).resolve(), metavar='FILE or FOLDER')
    places = parser.parse_args().places or [TOP / folder for folder in FOLDERS]
    found = check([path for place in places for path in (sorted(place.rglob('*.py')) if place.is_dir() else [place])])
    print('\n'.join(map(str, found)), end='\n' * bool(found))
    return int(bool(found))


if __name__ == '__main__':
    sys.exit(main())
