# SPDX-License-Identifier: BSD-3-Clause
import xmlrpc.client
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.udpros.negotiation import (
    MAX_HEADER_SIZE,
    Fallbacks,
    Refused,
    Reply,
    Request,
    decode_header,
    encode_header,
    is_other_version,
    other_type,
)

FIELDS = {'topic': '/chatter', 'md5sum': '992ce8a1687cec8c8bd883ec73ca41d1', 'callerid': '/listener',
          'type': 'std_msgs/String'}
HEADER = encode_header(FIELDS)
REQUEST = ['UDPROS', HEADER, 'operator', 40000, 1472]
REPLY = ['UDPROS', '10.0.0.1', 33333, 7, 1472, encode_header({'md5sum': '*', 'type': 'std_msgs/String'})]

# as roscpp's Header::write makes it, its 4 bytes of overall length cut off
ROSCPP_HEADER = (b'\x12\0\0\0callerid=/listener' b'\x27\0\0\0md5sum=992ce8a1687cec8c8bd883ec73ca41d1'
                 b'\x0e\0\0\0topic=/chatter' b'\x14\0\0\0type=std_msgs/String')


def changed(params, index, value) -> Any:
    return params[:index] + [value] + params[index + 1:]


def test_a_header_by_hand() -> None:
    assert encode_header(FIELDS) == ROSCPP_HEADER
    assert decode_header(ROSCPP_HEADER) == FIELDS
    assert encode_header({}) == b'' and decode_header(b'') == {}


@pytest.mark.parametrize('header', [HEADER, bytearray(HEADER), xmlrpc.client.Binary(HEADER), HEADER.decode()],
                         ids=['bytes', 'bytearray', 'Binary', 'str'])
def test_every_guise_of_xmlrpc_base64(header) -> None:
    assert Request.parse(changed(REQUEST, 1, header)).header == FIELDS


def test_a_value_may_hold_anything() -> None:
    fields = {'message_definition': 'a=b\n\n# \u00b0\0', 'empty': ''}
    assert decode_header(encode_header(fields)) == fields


def test_bytes_that_are_no_utf8_are_read() -> None:
    assert decode_header(b'\4\0\0\0a=\xff\xfe') == {'a': '\ufffd\ufffd'}


@pytest.mark.parametrize(('data', 'reason'), [
    (b'\1\0\0', 'ends within a length'),
    (b'\4\0\0\0a=b', 'ends within a field'),
    (HEADER + b'\xff\xff\xff\xff', 'ends within a field'),
    (HEADER[:-1], 'ends within a field'),
    (b'\5\0\0\0topic', "without \"=\": 'topic'"),
    (b'\0\0\0\0', 'without "="'),
    (bytes(MAX_HEADER_SIZE + 1), 'too long'),
])
def test_bad_headers(data, reason) -> None:
    with pytest.raises(Refused, match=reason):
        decode_header(data)


def test_parse() -> None:
    request = Request.parse(REQUEST)
    assert request == Request('operator', 40000, FIELDS, 1472)
    assert Request.parse(tuple(REQUEST)) == request
    assert Reply.parse(REPLY) == Reply('10.0.0.1', 33333, 7, 1472, {'md5sum': '*', 'type': 'std_msgs/String'})


@given(st.dictionaries(st.text('abc_', min_size=1), st.text(st.characters(blacklist_categories=('Cs',)))),
       st.integers(1, 65535), st.integers(64, 65507), st.integers(0, 0x7fffffff))
def test_there_and_back_through_xmlrpc(extra, port, size, connection_id) -> None:
    for message in (Request('host', port, {**FIELDS, **extra}, size),
                    Reply('host', port, connection_id, size, {**FIELDS, **extra})):
        (params,), _ = xmlrpc.client.loads(xmlrpc.client.dumps((message.params(),)))
        assert type(message).parse(params) == message


@pytest.mark.parametrize('size', [8, 0, 63, -1, 65508, 10 ** 9, 1 << 70, True, '1472', 1472.0, None, [1472]])
def test_sizes_that_are_refused(size) -> None:
    for message_class, params in ((Request, changed(REQUEST, 4, size)), (Reply, changed(REPLY, 4, size))):
        with pytest.raises(Refused, match=r'max_datagram_size is .+, not a whole number from 64 to 65507'):
            message_class.parse(params)


@pytest.mark.parametrize('port', [0, -1, 65536, '40000', None, True])
def test_ports_that_are_refused(port) -> None:
    with pytest.raises(Refused, match='port is .+ from 1 to 65535'):
        Request.parse(changed(REQUEST, 3, port))


@pytest.mark.parametrize('port', [-1, 65536, '40000', None, False])
def test_ports_that_are_refused_of_a_publisher(port) -> None:
    with pytest.raises(Refused, match='port is .+ from 0 to 65535'):
        Reply.parse(changed(REPLY, 2, port))


@pytest.mark.parametrize('connection_id', [-1, 1 << 31, 'x', 1.0, True])
def test_connection_ids_that_are_refused(connection_id) -> None:
    with pytest.raises(Refused, match='connection id is '):
        Reply.parse(changed(REPLY, 3, connection_id))


@pytest.mark.parametrize('host', ['', None, 5, b'host', 'a\0b', 'two\nlines', 'x' * 254, ['host']])
def test_hosts_that_are_refused(host) -> None:
    for message_class, params in ((Request, changed(REQUEST, 2, host)), (Reply, changed(REPLY, 1, host))):
        with pytest.raises(Refused, match='host is .+, not a name'):
            message_class.parse(params)


@pytest.mark.parametrize('header', [None, 5, 1 << 40, [HEADER], {'topic': '/chatter'}, 1.5])
def test_headers_of_other_types(header) -> None:
    with pytest.raises(Refused, match='not base64'):
        Request.parse(changed(REQUEST, 1, header))
    with pytest.raises(Refused, match='no connection header'):
        Reply.parse(changed(REPLY, 5, header))


@pytest.mark.parametrize('name', ['topic', 'md5sum', 'callerid'])
def test_what_a_request_needs(name) -> None:
    for header in ({**FIELDS, name: ''}, {key: value for key, value in FIELDS.items() if key != name}):
        with pytest.raises(Refused, match='lacks "%s"' % name):
            Request.parse(changed(REQUEST, 1, encode_header(header)))


@pytest.mark.parametrize('name', ['md5sum', 'type'])
def test_what_a_reply_needs(name) -> None:
    header = {key: value for key, value in FIELDS.items() if key != name}
    with pytest.raises(Refused, match='lacks "%s"' % name):
        Reply.parse(changed(REPLY, 5, encode_header(header)))


def test_a_publishers_error_is_passed_on() -> None:
    header = encode_header({'error': 'md5sums differ' + ' and differ' * 1000, **FIELDS})
    with pytest.raises(Refused, match='the publisher answers: md5sums differ') as refusal:
        Reply.parse(changed(REPLY, 5, header))
    assert len(str(refusal.value)) < 1000


def nested(depth) -> Any:
    value = []
    for _ in range(depth):
        value = [value]
    return value


@pytest.mark.parametrize('params', [
    None, 'UDPROS', [], {}, ['UDPROS'], ['TCPROS'], REQUEST + [1, 1], REQUEST[:4], ['TCPROS'] + REQUEST[1:],
    nested(100000), ['UDPROS', 'x' * 10 ** 7]], ids=lambda params: str(type(params)))
def test_no_such_list(params) -> None:
    for message_class in (Request, Reply):
        with pytest.raises(Refused, match='elements and begins with "UDPROS"') as refusal:
            message_class.parse(params)
        assert len(str(refusal.value)) < 500


SIMPLE = st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(), st.binary(),
                   st.builds(xmlrpc.client.Binary, st.binary()))
ANYTHING = st.recursive(
    SIMPLE, lambda inner: st.one_of(st.lists(inner), st.dictionaries(st.text(), inner)), max_leaves=8)


@given(st.one_of(ANYTHING, st.tuples(st.sampled_from([REQUEST, REPLY]), st.integers(0, 5), ANYTHING).map(
    lambda picked: changed(picked[0], *picked[1:]))))
def test_whatever_comes_is_taken_or_refused(params) -> None:
    for message_class in (Request, Reply):
        try:
            message_class.parse(params)
        except Refused as refusal:
            assert 0 < len(str(refusal)) < 1000


@given(st.binary())
def test_whatever_header_is_taken_or_refused(data) -> None:
    try:
        fields = decode_header(data)
    except Refused:
        return
    assert all(isinstance(text, str) for pair in fields.items() for text in pair)


def test_a_publisher_that_refuses_is_asked_again_less_and_less_often() -> None:
    fallbacks = Fallbacks()
    assert fallbacks.due(1e9) == []
    assert fallbacks.refused('a', 100.0)
    assert (fallbacks.due(102.9), fallbacks.due(103.0)) == ([], ['a'])
    assert not fallbacks.refused('a', 103.0)
    assert (fallbacks.due(108.9), fallbacks.due(109.0)) == ([], ['a'])
    for _ in range(10):
        fallbacks.refused('a', 200.0)
    assert (fallbacks.due(259.9), fallbacks.due(260.0)) == ([], ['a'])
    fallbacks.forget('a')
    fallbacks.forget('a')
    assert fallbacks.due(1e9) == []


def test_another_version_is_recognised_in_the_text_that_names_both() -> None:
    refusal = other_type('/chatter', 'std_msgs/String', 'a' * 32, 'b' * 32)
    assert str(refusal) == '[/chatter] is of type std_msgs/String with md5sum %s, not %s' % ('a' * 32, 'b' * 32)
    assert refusal.reason == 'type' and is_other_version(refusal)
    assert is_other_version(Refused('requestTopic: %s' % refusal))
    assert not is_other_version(Refused('no route to robot:5'))
