# SPDX-License-Identifier: BSD-3-Clause
"""The files of the page: small, flat, all loaded at once, nothing inline and nothing from outside."""
import pathlib
import re

import pytest

WEB = pathlib.Path(__file__).resolve().parents[2] / 'web'
FILES = sorted(WEB.iterdir())
SCRIPTS = [file for file in FILES if file.suffix == '.js']
INDEX = (WEB / 'index.html').read_text()

MOST_BYTES = 150_000
LONGEST = 250
"""Lines of a module."""


def test_all_together_are_small() -> None:
    assert sum(file.stat().st_size for file in FILES) < MOST_BYTES


def test_every_module_is_preloaded_once() -> None:
    preloaded = re.findall(r'<link rel="modulepreload" href="/static/(\w+\.js)">', INDEX)
    assert sorted([*preloaded, 'main.js']) == [script.name for script in SCRIPTS]


def test_nothing_is_inline() -> None:
    assert not re.search(r'<style|\sstyle=|\son\w+=|javascript:', INDEX)
    assert re.findall(r'<script[^>]*>(.*?)</script>', INDEX, re.DOTALL) == ['']


@pytest.mark.parametrize('file', FILES, ids=lambda file: file.name)
def test_nothing_comes_from_outside(file) -> None:
    outside = set(re.findall(r'https?://[^\s"\'`)]+', file.read_text())) - {'http://www.w3.org/2000/svg'}
    assert not outside


@pytest.mark.parametrize('script', SCRIPTS, ids=lambda file: file.name)
def test_texts_of_the_network_are_never_html(script) -> None:
    assert not re.search(r'innerHTML\s*=|outerHTML\s*=|insertAdjacentHTML|document\.write|\beval\(|new Function',
                         script.read_text())


@pytest.mark.parametrize('script', SCRIPTS, ids=lambda file: file.name)
def test_every_module_says_what_it_is_for_and_is_short(script) -> None:
    lines = script.read_text().splitlines()
    assert lines[0] == '// SPDX-License-Identifier: BSD-3-Clause'
    assert lines[1].startswith('/**')
    assert len(lines) <= LONGEST
    assert max(map(len, lines)) <= 140


@pytest.mark.parametrize('script', SCRIPTS, ids=lambda file: file.name)
def test_what_a_module_imports_is_there(script) -> None:
    for names, module in re.findall(r'import \{([^}]*)\} from \'\./(\w+\.js)\'', script.read_text()):
        exported = (WEB / module).read_text()
        for name in names.split(','):
            assert re.search(r'export (async )?(const|function|class) [^;]*\b%s\b' % name.strip(), exported), name
