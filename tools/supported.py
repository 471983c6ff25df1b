# SPDX-License-Identifier: BSD-3-Clause
"""Writes doc/install.md's table of what this package runs on, from tools/supported.txt, which ./smokebot reads too.

    python3 tools/supported.py           # write it
    python3 tools/supported.py --check   # exit with 1 where it is out of date
"""
import pathlib
import sys
from typing import List

TOP = pathlib.Path(__file__).resolve().parent.parent
SOURCE, PAGE = TOP / 'tools' / 'supported.txt', TOP / 'doc' / 'install.md'
BEGIN, END = '<!-- made by tools/supported.py -->\n', '<!-- end -->\n'

PREPARED = {'all': 'yes', 'part': 'in part', 'nothing': 'no: a catkin workspace'}


def rows(text: str) -> List[List[str]]:
    """The cells of each release: codename, name, prepared, missing, versions ...; the first row has their titles."""
    lines = [line for line in text.splitlines() if '|' in line]
    return [[cell.strip() for cell in line.lstrip('# ').split('|')] for line in lines]


def table(text: str) -> str:
    """The table, in Markdown."""
    (_, *titles), *releases = rows(text)
    titles[1:3] = ['`./smokebot`', 'without']
    lines = [titles, ['---'] * len(titles)]
    for _, name, prepared, *rest in releases:
        lines.append([name, PREPARED[prepared], *rest])
    return ''.join('| %s |\n' % ' | '.join(line) for line in lines)


def page(current: str, text: str) -> str:
    """The page with this table.

    :raises ValueError: it has no place for it
    """
    head, begin, rest = current.partition(BEGIN)
    _, end, tail = rest.partition(END)
    if not begin or not end:
        raise ValueError('%s has no lines %r and %r' % (PAGE.name, BEGIN, END))
    return head + BEGIN + table(text) + END + tail


def main(arguments: List[str]) -> int:
    """Write the table, or check it; returns the exit code."""
    current = PAGE.read_text()
    wanted = page(current, SOURCE.read_text())
    if arguments == ['--check']:
        if current != wanted:
            print('%s is out of date: run tools/supported.py' % PAGE.name, file=sys.stderr)
        return int(current != wanted)
    PAGE.write_text(wanted)
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
