# SPDX-License-Identifier: BSD-3-Clause
"""Key files: made, read, refused with one sentence."""
import os
import pathlib
import stat

import pytest

from smokebot_udp.link.keys import KEY_SIZE, LOOK_PERIOD, KeyFile, copy_command, make_key, read_key


def test_a_new_key_is_random_and_only_its_owner_reads_it(tmp_path: pathlib.Path) -> None:
    umask = os.umask(0)
    try:
        for name in ('one', 'two'):
            make_key(str(tmp_path / name))
    finally:
        os.umask(umask)
    one, two = (read_key(str(tmp_path / name)) for name in ('one', 'two'))
    assert len(one) == len(two) == KEY_SIZE == 32 and one != two
    assert stat.S_IMODE((tmp_path / 'one').stat().st_mode) == 0o600


def test_a_key_is_never_overwritten(tmp_path: pathlib.Path) -> None:
    path = tmp_path / 'key'
    path.write_bytes(b'k' * 32)
    with pytest.raises(ValueError, match='there is a file .* already'):
        make_key(str(path))
    assert path.read_bytes() == b'k' * 32


@pytest.mark.parametrize('size, what', [(0, 'short'), (31, 'short'), (33, 'long'), (1000, 'long')])
def test_a_key_of_another_length(tmp_path: pathlib.Path, size: int, what: str) -> None:
    path = tmp_path / 'key'
    path.write_bytes(b'k' * size)
    path.chmod(0o600)
    with pytest.raises(ValueError, match='too %s' % what) as error:
        read_key(str(path))
    assert 'kkk' not in str(error.value)


@pytest.mark.parametrize('mode', [0o640, 0o604, 0o620, 0o601, 0o644])
def test_a_key_that_is_open_to_others(tmp_path: pathlib.Path, mode: int) -> None:
    path = tmp_path / 'key'
    path.write_bytes(b'k' * 32)
    path.chmod(mode)
    with pytest.raises(ValueError, match='used by others'):
        read_key(str(path))
    path.chmod(0o400)
    assert read_key(str(path)) == b'k' * 32


@pytest.mark.parametrize('path', ['{}/missing', '{}', '{}/missing/key', '{}/nu\0ll'])
def test_a_file_that_cannot_be_read_or_made(tmp_path: pathlib.Path, path: str) -> None:
    for use in (read_key, make_key):
        if use is make_key and path in ('{}/missing', '{}/missing/key'):
            continue
        with pytest.raises(ValueError) as error:
            use(path.format(tmp_path))
        assert '\n' not in str(error.value)


def write(path: pathlib.Path, data: bytes, mode: int = 0o600) -> None:
    path.write_bytes(data)
    path.chmod(mode)


def test_a_key_file_is_replaced(tmp_path: pathlib.Path) -> None:
    path, told = tmp_path / 'key', []
    write(path, b'a' * 32)
    file = KeyFile(str(path), told.append)
    times = iter(range(0, 1000, 1 + int(LOOK_PERIOD)))
    assert file.key == b'a' * 32 and file.renewed(next(times)) is None
    write(path, b'b' * 32)
    assert file.renewed(0.5) is None        # it was looked at just now
    assert file.renewed(next(times)) == file.key == b'b' * 32 and file.renewed(next(times)) is None
    (tmp_path / 'new').write_bytes(b'c' * 32)
    (tmp_path / 'new').chmod(0o600)
    (tmp_path / 'new').rename(path)
    assert file.renewed(next(times)) == b'c' * 32 and not told


def test_what_is_no_key_does_not_replace_one(tmp_path: pathlib.Path) -> None:
    path, told = tmp_path / 'key', []
    write(path, b'a' * 32)
    file = KeyFile(str(path), told.append)
    times = iter(range(0, 1000, 1 + int(LOOK_PERIOD)))
    write(path, b'b' * 31)
    assert file.renewed(next(times)) is None and file.renewed(next(times)) is None
    write(path, b'b' * 32, 0o644)
    assert file.renewed(next(times)) is None
    path.unlink()
    assert file.renewed(next(times)) is None and file.key == b'a' * 32
    assert [text.split('. ')[-1] for text in told] == ['The former key stays in use'] * 3
    assert 'too short' in told[0] and 'others' in told[1] and 'cannot be read' in told[2]
    write(path, b'a' * 32)
    assert file.renewed(next(times)) is None and len(told) == 3


def test_a_key_is_made_with_its_folder_for_its_owner_only(tmp_path: pathlib.Path) -> None:
    path = tmp_path / 'new' / 'folder' / 'key'
    make_key(str(path))
    assert len(read_key(str(path))) == KEY_SIZE and path.parent.stat().st_mode & 0o777 == 0o700
    (tmp_path / 'file').touch()
    with pytest.raises(ValueError, match='key'):
        make_key(str(tmp_path / 'file' / 'key'))


def test_the_command_that_copies_a_key() -> None:
    assert copy_command('me@ugv1:/home/me/k', '~/keys/k') == 'mkdir -p ~/keys && scp -p me@ugv1:/home/me/k ~/keys/k'
