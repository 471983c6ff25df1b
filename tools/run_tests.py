# SPDX-License-Identifier: BSD-3-Clause
"""All of this checkout's checks and tests: `run_tests.py WORKSPACE [PYTEST_ARG ...]`, for ./smokebot test.

ruff, vermin, catkin_lint, then the workspace's tests by catkin, which exits with 0 even where tests fail: what
counts is in the JUnit files they leave. With PYTEST_ARGs only pytest runs, with these.
"""
import fcntl
import pathlib
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

TOP = pathlib.Path(__file__).resolve().parent.parent


def checks(workspace):
    # by its place in the workspace: a checkout's folder may have any name
    package = str(workspace / 'src' / 'smokebot_udp')
    # vermin, because ruff and ast know Python 3.8's grammar but not its library (str.removeprefix, functools.cache)
    return {'ruff': ['ruff', 'check', '.'],
            'vermin': ['vermin', '--target=3.8-', '--no-tips', '--violations', '--quiet', '.'],
            'catkin_lint': ['catkin_lint', '-W2', '--strict', '--quiet', '--offline', package]}


def say(text):
    print('smokebot: ' + text, file=sys.stderr, flush=True)


def run_checks(workspace):
    """Run the checks: (how many pass, how many fail)."""
    failed = 0
    for name, command in checks(workspace).items():
        say(name)
        if subprocess.run(command, cwd=TOP).returncode:
            failed += 1
            say('FAILED %s' % name)
    return len(checks(workspace)) - failed, failed


def run_workspace_tests(workspace):
    """Run catkin's tests one after the other: (whether that came to its end, their JUnit files, none older)."""
    results = workspace / 'build' / 'test_results'
    shutil.rmtree(results, ignore_errors=True)
    say('the tests')
    ended = subprocess.run(['catkin_make', '-C', str(workspace), '--no-color', '-j1', 'run_tests'],
                           stdin=subprocess.DEVNULL).returncode == 0
    if not ended:
        say('FAILED catkin_make run_tests')
    return ended, sorted(results.rglob('*.xml'))


def count(files):
    """(passed, failed, skipped) of the JUnit files; says which tests failed. A file without a test is a failure."""
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
            name = '%s.%s' % (case.get('classname'), case.get('name'))
            if case.find('failure') is not None or case.find('error') is not None:
                failed += 1
                say('FAILED %s (%s)' % (name, file.name))
            elif case.find('skipped') is not None:
                skipped += 1
                say('skipped %s: %s' % (name, case.find('skipped').get('message', 'no reason given')))
            elif case.get('classname') != 'rostest.runner.RosTest':  # that one says only that a test was run
                passed += 1
    return passed, failed, skipped


def main(workspace, *pytest_args):
    if pytest_args:
        return subprocess.run([sys.executable, '-m', 'pytest', *pytest_args], cwd=TOP).returncode
    workspace = pathlib.Path(workspace)
    with open(str(workspace / 'tests.lock'), 'w') as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            say('waiting for another ./smokebot test')
            fcntl.flock(lock, fcntl.LOCK_EX)
        good_checks, failed_checks = run_checks(workspace)
        ended, files = run_workspace_tests(workspace)
        passed, failed, skipped = count(files)
    failed += failed_checks + (not ended)
    say('%d of %d checks passed, and of the tests:' % (good_checks, good_checks + failed_checks))
    print('%d passed, %d failed, %d skipped' % (passed, failed, skipped), flush=True)
    return 0 if passed and not failed else 1


if __name__ == '__main__':
    sys.exit(main(*sys.argv[1:]))
