# SPDX-License-Identifier: BSD-3-Clause
"""The list of releases, as ./smokebot reads it and as doc/install.md shows it."""
import pathlib
import re
import subprocess

import pytest

from tools import supported

SCRIPT = supported.TOP / 'smokebot'
FUNCTIONS = ''.join(re.findall(r'^(?:column|check_machine)\(\) \{.*?\}\n(?=\n)', SCRIPT.read_text(),
                               re.DOTALL | re.MULTILINE))


def check(tmp_path: pathlib.Path, release: str) -> 'subprocess.CompletedProcess[str]':
    """What ./smokebot says of a machine whose /etc/os-release has this text."""
    (tmp_path / 'os-release').write_text(release)
    functions = FUNCTIONS.replace('/etc/os-release', str(tmp_path / 'os-release'))
    script = ('set -euo pipefail\ntop=$1 state=$1\nsay() { echo "$*"; }\ndie() { say "$*"; exit 1; }\n'
              '%s\ncheck_machine')
    return subprocess.run(['bash', '-c', script % functions, 'bash', str(supported.TOP)], stdout=subprocess.PIPE,
                          text=True)


@pytest.mark.parametrize('codename', ['bookworm', 'trixie'])
def test_a_supported_release_is_prepared(tmp_path: pathlib.Path, codename: str) -> None:
    done = check(tmp_path, 'ID=debian\nVERSION_CODENAME=%s\n' % codename)
    assert done.returncode == 0 and done.stdout == ''


def test_of_one_that_runs_a_part_it_says_what_is_missing(tmp_path: pathlib.Path) -> None:
    done = check(tmp_path, 'ID=debian\nVERSION_CODENAME=forky\n')
    assert done.returncode == 0
    assert done.stdout.startswith('Debian 14 (testing) runs a part of this package, without: rviz')


@pytest.mark.parametrize('release', ['VERSION_CODENAME=focal\n', 'VERSION_CODENAME=buster\n', 'ID=arch\n', ''])
def test_another_is_refused(tmp_path: pathlib.Path, release: str) -> None:
    done = check(tmp_path, release)
    assert done.returncode == 1 and 'Debian 12 and 13' in done.stdout and 'Install on a robot' in done.stdout


def test_the_page_shows_the_list() -> None:
    assert supported.main(['--check']) == 0
    names = [row[1] for row in supported.rows(supported.SOURCE.read_text())[1:]]
    assert all('| %s |' % name in supported.PAGE.read_text() for name in names) and len(names) == 5


def test_the_table_by_hand() -> None:
    text = ('# a comment\n# codename | release | prepared | what is missing | rospy\n'
            'sid | Debian 99 | part | rviz | 2.0\n')
    assert supported.table(text) == ('| release | `./smokebot` | without | rospy |\n| --- | --- | --- | --- |\n'
                                     '| Debian 99 | in part | rviz | 2.0 |\n')
    made = supported.page('a\n%sold\n%sb\n' % (supported.BEGIN, supported.END), text)
    assert made.startswith('a\n' + supported.BEGIN) and made.endswith(supported.END + 'b\n') and 'old' not in made
    with pytest.raises(ValueError, match='has no lines'):
        supported.page('nothing', text)
