# SPDX-License-Identifier: BSD-3-Clause
"""README.md and doc/: links and anchors resolve, and the commands name scripts and arguments that exist."""
import pathlib
import re
import xml.etree.ElementTree as ElementTree
from typing import Iterator, List, Set, Tuple

import pytest

TOP = pathlib.Path(__file__).resolve().parent.parent.parent
README, INDEX = TOP / 'README.md', TOP / 'doc' / 'README.md'
PAGES = [README, *sorted((TOP / 'doc').glob('*.md'))]

MAX_LINES = 220
"""Maximum number of lines of README.md: more is not read. Everything else belongs into doc/."""

LINK = re.compile(r'!?\[[^]]*\]\(([^)\s]+)\)')
CODE = re.compile(r'^(```.*?^```|<!--.*?-->)', re.MULTILINE | re.DOTALL)
BLOCK = re.compile(r'^ *```\w*\n(.*?)^ *```', re.MULTILINE | re.DOTALL)


def prose(page: pathlib.Path) -> str:
    """A page without its blocks of code and comments."""
    return CODE.sub('', page.read_text())


def anchor(heading: str) -> str:
    """The anchor that GitHub makes of a heading: lower case, without punctuation, hyphens for spaces."""
    shown = re.sub(r'\[([^]]*)\]\([^)]*\)', r'\1', heading)
    return re.sub(r'[^\w\- ]', '', shown.strip().lower()).replace(' ', '-')


def anchors(text: str) -> Set[str]:
    """Those of all headings of a page; of equal ones the later have a number."""
    found: List[str] = []
    for heading in re.findall(r'^#+ (.*)$', text, re.MULTILINE):
        base = anchor(heading)
        found.append('%s-%d' % (base, found.count(base)) if base in found else base)
    return set(found)


def broken(page: pathlib.Path, top: pathlib.Path = TOP) -> Iterator[str]:
    """The relative links of a page that lead nowhere.

    :param top: the checkout, which no link may leave
    """
    for target in LINK.findall(prose(page)):
        if re.match(r'\w+:', target):
            continue
        path, _, name = target.partition('#')
        file = (page.parent / path).resolve() if path else page
        if not file.exists() or top not in file.parents or (name and name not in anchors(prose(file))):
            yield target


def commands(page: pathlib.Path) -> Iterator[str]:
    """The lines of a page's blocks of code, without their comments."""
    for block in BLOCK.findall(page.read_text()):
        for line in block.splitlines():
            yield line.partition(' #')[0]


def test_the_readme_is_short() -> None:
    assert len(README.read_text().splitlines()) <= MAX_LINES


@pytest.mark.parametrize('page', PAGES, ids=lambda page: str(page.relative_to(TOP)))
def test_all_links_resolve(page: pathlib.Path) -> None:
    assert list(broken(page)) == []


def test_a_broken_link_is_found(tmp_path: pathlib.Path) -> None:
    page, other = tmp_path / 'page.md', tmp_path / 'other.md'
    other.write_text('# A & B: `c_d`\n\n## Twice\n\n## Twice\n\n```\n# no heading\n```\n')
    page.write_text('# Top\n[1](other.md#a--b-c_d) [2](#top) [3](other.md#twice-1) [4](http://away/x) ![5](none.png)\n'
                    '[6](other.md#no-heading) [7](#bottom) [8](../out.md)\n```\n[9](code)\n```\n')
    assert list(broken(page, tmp_path)) == ['none.png', 'other.md#no-heading', '#bottom', '../out.md']


def test_the_index_names_every_page() -> None:
    linked = {(INDEX.parent / link.partition('#')[0]).resolve() for link in LINK.findall(prose(INDEX))}
    assert [page.name for page in PAGES if page not in (*linked, INDEX)] == []


def test_the_pages_name_modules_that_exist() -> None:
    known = {path.name for folder in ('src', 'evaluation', 'experiments', 'benchmarks', 'tools', 'test', 'scripts')
             for path in (TOP / folder).rglob('*.py')}
    unknown = {(page.name, path) for page in PAGES for path in re.findall(r'`([\w/]+\.py)`', prose(page))
               if path.rsplit('/', 1)[-1] not in known}
    assert unknown == set()


def called(pattern: str) -> List[Tuple[str, List[str]]]:
    """[(the first group, the words after it)] of each command of the pages that matches."""
    return [(match.group(1), match.group(2).split()) for page in PAGES for line in commands(page)
            for match in re.finditer(pattern + r'(.*)', line)]


def test_the_commands_name_scripts_of_this_package() -> None:
    found = {name for name, _ in called(r'\brosrun smokebot_udp (\w+)')}
    assert found and found <= {path.name for path in (TOP / 'scripts').iterdir()}


def test_the_commands_name_arguments_of_the_launch_files() -> None:
    found = called(r'\broslaunch (?:-\S+ )*smokebot_udp (\w+\.launch)')
    assert found
    for launch, words in found:
        known = {one.get('name') for one in ElementTree.parse(str(TOP / 'launch' / launch)).getroot().iter('arg')}
        assert {word.partition(':=')[0] for word in words if ':=' in word} <= known, launch
