# SPDX-License-Identifier: BSD-3-Clause
import pytest

from smokebot_udp.web.access import SESSION_LIFE, TRIES, TRY_PERIOD, Access, Refused, Role, is_local, is_own

PAGE, DRIVER = bytes(range(32)), bytes(range(100, 132))


def test_a_token_begins_a_session_that_ends() -> None:
    access = Access(PAGE, DRIVER)
    session = access.login(PAGE.hex(), '', 'tablet', 10.0, 'random')
    assert session == 'random' and access.role(session, False, 10.0) is Role.VIEWER
    assert access.role('other', False, 10.0) is Role.NONE
    assert access.role(session, False, 10.0 + SESSION_LIFE) is Role.NONE
    access.logout(session)
    assert access.role(session, False, 10.0) is Role.NONE


def test_the_drivers_token_adds_to_a_session_and_is_never_lost() -> None:
    access = Access(PAGE, DRIVER)
    session = access.login(PAGE.hex().upper() + '\n', '', 'tablet', 10.0, 'first')
    assert access.login(DRIVER.hex(), session, 'tablet', 11.0, 'second') == 'first'
    assert access.role('first', False, 11.0) is Role.DRIVER
    assert access.login(PAGE.hex(), session, 'tablet', 12.0, 'third') == 'first'
    assert access.role('first', False, 12.0) is Role.DRIVER


def test_a_session_that_nobody_gave_out_is_not_taken_over() -> None:
    assert Access(PAGE, None).login(PAGE.hex(), 'planted', 'tablet', 10.0, 'random') == 'random'


@pytest.mark.parametrize('token', ['', PAGE.hex()[:-1], PAGE.hex()[:-2], PAGE.hex() + '00', 'ff' * 32, 'not hex', '\0',
                                   'é' * 64, '٣' * 64])
def test_a_wrong_token_begins_nothing(token) -> None:
    access = Access(PAGE, DRIVER)
    with pytest.raises(Refused, match='wrong'):
        access.login(token, '', 'tablet', 10.0, 'random')
    assert access.role('random', True, 10.0) is Role.NONE


def test_who_tries_often_waits_and_others_do_not() -> None:
    access, now = Access(PAGE, None), 1000.0
    for _ in range(TRIES):
        with pytest.raises(Refused):
            access.login('00', '', 'guesser', now, 'random')
    with pytest.raises(Refused) as refused:
        access.login(PAGE.hex(), '', 'guesser', now, 'random')
    assert refused.value.too_many
    assert access.login(PAGE.hex(), '', 'tablet', now, 'random') == 'random'
    assert access.login(PAGE.hex(), '', 'guesser', now + TRY_PERIOD, 'again') == 'again'


def test_without_a_token_only_this_machine_sees_the_page_and_nobody_drives() -> None:
    access = Access(None, None)
    assert access.role('', True, 0.0) is Role.VIEWER and access.role('', False, 0.0) is Role.NONE
    with pytest.raises(Refused):
        access.login('', '', 'tablet', 10.0, 'random')
    assert Access(PAGE, None).role('', True, 0.0) is Role.NONE
    assert Access(None, DRIVER).login(DRIVER.hex(), '', '127.0.0.1', 10.0, 'random') == 'random'


@pytest.mark.parametrize('origin, host, secure, own', [
    (None, 'desk:8080', False, True), ('http://desk:8080', 'desk:8080', False, True),
    ('http://DESK:8080', 'desk:8080', False, True), ('https://desk:8080', 'desk:8080', True, True),
    ('http://desk:8080', 'desk:8080', True, False), ('http://evil', 'desk:8080', False, False),
    ('null', 'desk:8080', False, False), ('http://desk', 'desk:8080', False, False),
    ('http://desk:8080.evil.org', 'desk:8080', False, False)])
def test_other_pages_are_refused(origin, host, secure, own) -> None:
    assert is_own(origin, host, secure) == own


@pytest.mark.parametrize('address, host, local', [
    ('127.0.0.1', 'localhost:8080', True), ('127.0.0.1', '127.0.0.1', True), ('::1', '[::1]:8080', True),
    ('10.0.0.2', 'localhost:8080', False), ('127.0.0.1', 'evil.org:8080', False), ('127.0.0.1', '', False),
    ('127.0.0.1', 'localhost.evil.org', False), ('', 'localhost', False), ('127.0.0.1', '[', False)])
def test_a_name_of_somebody_else_that_leads_here_is_not_local(address, host, local) -> None:
    assert is_local(address, host) == local
