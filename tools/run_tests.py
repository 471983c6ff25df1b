# SPDX-License-Identifier: BSD-3-Clause
"""All checks and tests of this checkout: `run_tests.py WORKSPACE [PYTEST_ARG ...]`, for ./smokebot test.

Runs ruff, mypy, vermin and catkin_lint, and checks docstrings and the generated documentation; then the workspace's
tests by catkin. catkin exits with 0 even where tests fail, so the JUnit files that the tests write decide. With
PYTEST_ARGs only pytest runs, with these.
"""
import fcntl
import pathlib
import shutil
import subprocess
import sys
import textwrap
import xml.etree.ElementTree as ElementTree
from typing import Dict, Iterable, List, Tuple

TOP = pathlib.Path(__file__).resolve().parent.parent
REASON_LINES = 30
"""Number of last lines of a failed test's text that are repeated at the end, where a long log is cut."""


def checks(workspace: pathlib.Path) -> Dict[str, List[str]]:
    """The command of each check."""
    # by its path in the workspace: a checkout's folder may have any name
    package = str(workspace / 'src' / 'smokebot_udp')
    # ruff and mypy know Python 3.8's grammar, vermin also its library (str.removeprefix, functools.cache)
    return {'ruff': ['ruff', 'check', '.'],
            'mypy': ['mypy'],
            'docstrings': [sys.executable, 'tools/check_language.py'],
            'doc/parameters.md': [sys.executable, 'tools/parameter_tables.py', '--check'],
            'doc/install.md': [sys.executable, 'tools/supported.py', '--check'],
            'vermin': ['vermin', '--target=3.8-', '--no-tips', '--violations', '--quiet', '.'],
            'catkin_lint': ['catkin_lint', '-W2', '--strict', '--quiet', '--offline', package]}


def say(text: str) -> None:
    """Write a line about the progress."""
    print('smokebot: ' + text, file=sys.stderr, flush=True)


def run_checks(workspace: pathlib.Path) -> Tuple[int, int]:
    """Run the checks; the numbers of those that passed and failed."""
    passed = failed = 0
    for name, command in checks(workspace).items():
        say(name)
        if subprocess.run(command, cwd=TOP).returncode:
            failed += 1
            say('FAILED %s' % name)
        else:
            passed += 1
    return passed, failed


def run_workspace_tests(workspace: pathlib.Path) -> Tuple[bool, List[pathlib.Path]]:
    """Run catkin's tests one after the other; whether all ran, and their JUnit files, none older."""
    results = workspace / 'build' / 'test_results'
    shutil.rmtree(results, ignore_errors=True)
    say('the tests')
    finished = subprocess.run(['catkin_make', '-C', str(workspace), '--no-color', '-j1', 'run_tests'],
                              stdin=subprocess.DEVNULL).returncode == 0
    if not finished:
        say('FAILED catkin_make run_tests')
    return finished, sorted(results.rglob('*.xml'))


def outcome(case: ElementTree.Element) -> str:
    """The outcome of a JUnit testcase: 'failed', 'skipped: ' and the reason, 'passed', or '' where it is no test."""
    if case.find('failure') is not None or case.find('error') is not None:
        return 'failed'
    skipped = case.find('skipped')
    if skipped is not None:
        return 'skipped: ' + skipped.get('message', 'no reason given')
    # rostest's own case only says that a test was run
    return '' if case.get('classname') == 'rostest.runner.RosTest' else 'passed'


def reason(case: ElementTree.Element) -> str:
    """The end of what a failed JUnit testcase says, indented."""
    said = ''.join((fault.get('message') or '') + '\n' + (fault.text or '')
                   for fault in case if fault.tag in ('failure', 'error'))
    return textwrap.indent('\n'.join(said.strip().splitlines()[-REASON_LINES:]), '    ')


def count(files: Iterable[pathlib.Path]) -> Tuple[int, int, int]:
    """The numbers of tests in JUnit files that passed, failed and were skipped. A file without a test is a failure."""
    passed = failed = skipped = 0
    for file in files:
        try:
            cases = list(ElementTree.parse(file).iter('testcase'))
        except ElementTree.ParseError:
            cases = []
        if not cases:
            say('FAILED %s: no result in it' % file.name)
            failed += 1
        for case in cases:
            name, result = '%s.%s' % (case.get('classname'), case.get('name')), outcome(case)
            if result == 'failed':
                say('FAILED %s (%s)\n%s' % (name, file.name, reason(case)))
            elif result.startswith('skipped'):
                say('skipped %s%s' % (name, result[len('skipped'):]))
            passed, failed = passed + (result == 'passed'), failed + (result == 'failed')
            skipped += result.startswith('skipped')
    return passed, failed, skipped


def main(workspace_path: str, *pytest_args: str) -> int:
    """Run everything, or pytest; the exit status."""
    if pytest_args:
        return subprocess.run([sys.executable, '-m', 'pytest', *pytest_args], cwd=TOP).returncode
    workspace = pathlib.Path(workspace_path)
    with open(str(workspace / 'tests.lock'), 'w') as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            say('waiting for another ./smokebot test')
            fcntl.flock(lock, fcntl.LOCK_EX)
        passed_checks, failed_checks = run_checks(workspace)
        finished, files = run_workspace_tests(workspace)
        passed, failed, skipped = count(files)
    failed += failed_checks + (not finished)
    say('%d of %d checks passed, and of the tests:' % (passed_checks, passed_checks + failed_checks))
    print('%d passed, %d failed, %d skipped' % (passed, failed, skipped), flush=True)
    return 0 if passed and not failed else 1


if __name__ == '__main__':
    sys.exit(main(*sys.argv[1:]))
