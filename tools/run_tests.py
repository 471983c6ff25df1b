# SPDX-License-Identifier: BSD-3-Clause
"""All of this checkout's checks and tests: `run_tests.py WORKSPACE [PYTEST_ARG ...]`, for ./smokebot test.

ruff, catkin_lint, then the workspace's tests by catkin, which exits with 0 even where tests fail: what
counts is in the JUnit files they leave. With PYTEST_ARGs only pytest runs, with these.
"""
import pathlib
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

TOP = pathlib.Path(__file__).resolve().parent.parent


def checks(workspace):
    # by its place in the workspace: a checkout's folder may have any name
    package = str(workspace / 'src' / 'smokebot_udp')
    return {'ruff': ['ruff', 'check', '.'],
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
    """Run catkin's tests one after the other; returns the JUnit files, none older than this run."""
    results = workspace / 'build' / 'test_results'
    shutil.rmtree(results, ignore_errors=True)
    say('the tests')
    subprocess.run(['catkin_make', '-C', str(workspace), '--no-color', '-j1', 'run_tests'], stdin=subprocess.DEVNULL)
    return sorted(results.rglob('*.xml'))


def count(files):
    """(passed, failed, skipped) of the JUnit files; says which tests failed. A file that is none is a failure."""
    passed = failed = skipped = 0
    for file in files:
        try:
            cases = list(ElementTree.parse(file).iter('testcase'))
        except ElementTree.ParseError:
            say('no result in %s' % file.name)
            failed += 1
            continue
        for case in cases:
            name = '%s.%s' % (case.get('classname'), case.get('name'))
            if case.find('failure') is not None or case.find('error') is not None:
                failed += 1
                say('FAILED %s (%s)' % (name, file.name))
            elif case.find('skipped') is not None:
                skipped += 1
                say('skipped %s: %s' % (name, case.find('skipped').get('message', 'no reason given')))
            else:
                passed += 1
    return passed, failed, skipped


def main(workspace, *pytest_args):
    if pytest_args:
        return subprocess.run([sys.executable, '-m', 'pytest', *pytest_args], cwd=TOP).returncode
    workspace = pathlib.Path(workspace)
    good_checks, failed_checks = run_checks(workspace)
    passed, failed, skipped = count(run_workspace_tests(workspace))
    say('%d of %d checks passed, and of the tests:' % (good_checks, good_checks + failed_checks))
    print('%d passed, %d failed, %d skipped' % (passed, failed + failed_checks, skipped), flush=True)
    return 0 if passed and not failed and not failed_checks else 1


if __name__ == '__main__':
    sys.exit(main(*sys.argv[1:]))
