# SPDX-License-Identifier: BSD-3-Clause
import pathlib
from typing import Any

import pytest

from smokebot_udp.link.keys import read_key
from smokebot_udp.nodes.make_key import main


def test_a_key_file_is_for_its_owner_and_never_overwritten(tmp_path: pathlib.Path, monkeypatch: Any) -> None:
    path = tmp_path / 'ugv1.key'
    monkeypatch.setattr('sys.argv', ['make_key', str(path)])
    main()
    key = path.read_bytes()
    assert len(key) == 32 and path.stat().st_mode & 0o777 == 0o600 and read_key(str(path)) == key
    with pytest.raises(SystemExit, match='make_key: there is a file .*ugv1.key'):
        main()
    assert path.read_bytes() == key


def test_a_token_is_shown_in_digits_that_can_be_typed(tmp_path: pathlib.Path, monkeypatch: Any, capsys: Any) -> None:
    path = tmp_path / 'page.key'
    monkeypatch.setattr('sys.argv', ['make_key', str(path)])
    main()
    monkeypatch.setattr('sys.argv', ['make_key', '--show', str(path)])
    main()
    assert bytes.fromhex(capsys.readouterr().out.strip()) == path.read_bytes()
    path.chmod(0o644)
    with pytest.raises(SystemExit, match='can be used by others'):
        main()
