# SPDX-License-Identifier: BSD-3-Clause
"""NAL units, their bits, parameter sets and slice headers: golden bytes of libx264, and hostile ones."""
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from smokebot_udp.codecs.video import nal, parameter_sets, slice_header
from smokebot_udp.codecs.video.parameter_sets import ParameterSets
from smokebot_udp.codecs.wire.bits import BitReader, BitWriter, escaped, unescaped

GREY = bytes.fromhex('0000000167640016f2d01787b42000000300200000030291e2c5d4' '0000000168ef3eb0')
COLOUR = bytes.fromhex('0000000167640016acb405e1ed08000003000800000300a478b175' '0000000168ef3eb0')
"""Parameter sets of libx264, 752 x 480: high profile, CABAC, weighted prediction, one reference."""

INTRA = bytes.fromhex('0000000167641033f2e05e1ed080000003008000000a42' '0000000168ee3eb0')
"""Likewise, grey, with intra images only."""

GREY_SETS = ParameterSets(height=480, width=752, macroblocks=1410, is_grey=True, frame_num_bits=4, picture_id=0,
                          arithmetic=True, references=1, weighted=True, qp=26, deblocking_control=True,
                          redundant=False, predicted=True)


def sequence_of(profile: int = 66, poc_type: int = 2, columns: int = 2, rows: int = 2, progressive: bool = True,
                right: int = 0) -> bytes:
    """A sequence parameter set, field by field (7.3.2.1.1)."""
    writer = BitWriter()
    writer.bits(profile << 16 | 30, 24)
    for value in (0, 0, poc_type, 1):
        writer.unsigned(value)
    writer.bits(0, 1)
    writer.unsigned(columns - 1)
    writer.unsigned(rows - 1)
    writer.bits(progressive, 1)
    writer.bits(1, 1)
    writer.bits(1, 1)
    for value in (0, right, 0, 0):
        writer.unsigned(value)
    writer.bits(1, 2)
    return b'\x67' + escaped(writer.payload(0))


def picture_of(arithmetic: bool = False, references: int = 1, weighted: bool = False, sequence: int = 0,
               control: bool = False) -> bytes:
    """A picture parameter set (7.3.2.2)."""
    writer = BitWriter()
    writer.unsigned(0)
    writer.unsigned(sequence)
    writer.bits(arithmetic, 1)
    writer.bits(0, 1)
    for value in (0, references - 1, 0):
        writer.unsigned(value)
    writer.bits(weighted << 2, 3)
    for _ in range(3):
        writer.signed(0)
    writer.bits(control << 2 | 0b001, 4)
    return b'\x68' + escaped(writer.payload(0))


def test_a_byte_stream_is_split_at_its_start_codes() -> None:
    stream = b'\0\0\1\x67\1\2\0\0\0\1\x68\3\0\0\0\0\1\x41\0\0\3\1\0'
    assert nal.split(stream) == [b'\x67\1\2', b'\x68\3', b'\x41\0\0\3\1']
    assert [nal.unit_type(unit) for unit in nal.split(stream)] == [7, 8, 1]
    assert nal.byte_stream([b'\x67\1', b'\x68']) == b'\0\0\0\1\x67\1\0\0\0\1\x68'


@pytest.mark.parametrize('stream', [b'', b'\0\0\0', b'\0\0\1', b'\0\0\0\1\0\0\0\1', b'no start code'])
def test_a_stream_without_units(stream) -> None:
    assert nal.split(stream) == []


@given(st.binary())
@settings(deadline=None)
def test_splitting_never_fails_and_is_the_inverse_of_joining(stream) -> None:
    units = nal.split(stream)
    assert all(units)
    assert nal.split(nal.byte_stream(units)) == units


@given(st.lists(st.sampled_from([0, 0, 0, 1, 2, 3, 4, 255])).map(bytes))
@example(b'\0\0\0\0\1')
def test_escaped_bytes_hold_no_start_code(payload) -> None:
    data = escaped(payload)
    assert not any(code in data for code in (b'\0\0\0', b'\0\0\1', b'\0\0\2')) and not data.endswith(b'\0')
    if not payload.endswith(b'\0'):
        assert unescaped(data) == payload


def test_exp_golomb_codes_by_hand() -> None:
    # table 9-2: 1, 010, 011, 00100; table 9-3: 0, 1, -1, 2
    writer = BitWriter()
    for value in (0, 1, 2, 3):
        writer.unsigned(value)
    for value in (0, 1, -1, 2):
        writer.signed(value)
    assert writer.payload(0) == bytes([0b10100110, 0b01001010, 0b01100100])
    reader = BitReader(writer.payload(0))
    assert [reader.unsigned(9) for _ in range(4)] + [reader.signed(9) for _ in range(4)] == [0, 1, 2, 3, 0, 1, -1, 2]


@pytest.mark.parametrize('payload, message', [
    (b'', '0 are left'), (b'\0\0\0\0\0', 'more than 31 zeros'), (b'\0\x80', '7 are left'),
    (b'\x38', 'is 6, must be at most 5')])
def test_exp_golomb_codes_that_are_not(payload, message) -> None:
    with pytest.raises(ValueError, match=message):
        BitReader(payload).unsigned(5)


def test_parameter_sets_of_libx264() -> None:
    assert parameter_sets.parse(GREY) == GREY_SETS
    assert parameter_sets.parse(COLOUR) == GREY_SETS._replace(is_grey=False)
    assert parameter_sets.parse(INTRA) == GREY_SETS._replace(weighted=False, predicted=False)


def test_parameter_sets_of_the_baseline_profile() -> None:
    stream = nal.byte_stream([picture_of(references=2), sequence_of(right=3)])
    assert parameter_sets.parse(stream) == ParameterSets(
        height=32, width=26, macroblocks=4, is_grey=False, frame_num_bits=4, picture_id=0, arithmetic=False,
        references=2, weighted=False, qp=26, deblocking_control=False, redundant=False, predicted=True)


@pytest.mark.parametrize('units, message', [
    ([sequence_of()], 'there are 1'),
    ([], 'there are 0'),
    ([sequence_of(), sequence_of(), picture_of()], 'of type 7'),
    ([sequence_of(), picture_of(), b'\x65\x88'], 'of type 5'),
    ([sequence_of(poc_type=0), picture_of()], 'order of decoding'),
    ([sequence_of(columns=1056), picture_of()], 'at most 1054'),
    ([sequence_of(columns=1055, rows=1055), picture_of()], '1113025 macroblocks'),
    ([sequence_of(progressive=False), picture_of()], 'interlaced'),
    ([sequence_of(right=16), picture_of()], 'cropped'),
    ([sequence_of(), picture_of(sequence=1)], 'another sequence'),
    ([sequence_of()[:4], picture_of()], 'are left'),
    ([sequence_of() + bytes([9]) * 300, picture_of()], 'at most 256'),
])
def test_parameter_sets_that_are_refused(units, message) -> None:
    with pytest.raises(ValueError, match=message):
        parameter_sets.parse(nal.byte_stream(units))


@given(st.integers(0, 8 * len(GREY) - 1), st.integers(1, len(GREY)))
@settings(max_examples=300, deadline=None)
def test_damaged_parameter_sets_are_refused_or_within_bounds(bit, length) -> None:
    data = bytearray(GREY)
    data[bit // 8] ^= 1 << bit % 8
    try:
        sets = parameter_sets.parse(bytes(data[:length]))
    except ValueError:
        return
    assert 0 < sets.macroblocks <= 139264 and sets.height * sets.width <= 256 * sets.macroblocks
    slice_header.lost_slice(sets, 3)


def test_the_header_of_an_image_that_was_lost_by_hand() -> None:
    unit = slice_header.lost_slice(GREY_SETS, 21)
    # first 0, P, parameter set 0, frame_num 21 % 16, references as usual; one weight table of grey: 1, 0;
    # no marking, cabac_init_idc 0, quantiser + 25 = 0000 0110 010, no deblocking 010, then ones up to a byte
    bits = '1' '1' '1' '0101' '00' '1' '0' '0' '1' '00000110010' '010' '11111'
    assert unit[:5] == bytes([0x41]) + int(bits, 2).to_bytes(4, 'big')
    assert unescaped(unit)[5:] == bytes(12 + 1410 // 64) + b'\x80'
    assert slice_header.parse(unit, GREY_SETS) == slice_header.SliceHeader(0, False, 5, 51)


def test_an_image_that_was_lost_without_arithmetic_coding_by_hand() -> None:
    sets = parameter_sets.parse(nal.byte_stream([sequence_of(), picture_of()]))
    # ..., quantiser + 25, then a run of 4 skipped macroblocks 00101, and the stop bit
    bits = '1' '1' '1' '0011' '00' '0' '00000110010' '00101' '1' '00000'
    assert slice_header.lost_slice(sets, 3) == bytes([0x41]) + int(bits, 2).to_bytes(4, 'big')


@given(st.booleans(), st.booleans(), st.booleans(), st.booleans(), st.integers(0, 51), st.integers(1, 3),
       st.integers(4, 16), st.integers(0, 1 << 20))
def test_headers_are_read_as_they_are_written(grey, weighted, arithmetic, control, qp, references, bits, number
                                              ) -> None:
    sets = GREY_SETS._replace(is_grey=grey, weighted=weighted, arithmetic=arithmetic, deblocking_control=control, qp=qp,
                              references=references, frame_num_bits=bits)
    header = slice_header.parse(slice_header.lost_slice(sets, number), sets)
    assert header == slice_header.SliceHeader(0, False, number % (1 << bits), 51)


@pytest.mark.parametrize('unit, message', [
    (b'', 'type 0'), (b'\x67\x42', 'type 7'), (b'\x41', 'left'), (b'\x41\xa8', 'type 1'), (b'\x65\xe0', 'type 0'),
    (b'\x41\xd0\0', 'other parameter sets'), (b'\x41\0\x2c\x18', 'is 1410, must be at most 1409')])
def test_slices_that_are_refused(unit, message) -> None:
    with pytest.raises(ValueError, match=message):
        slice_header.parse(unit, GREY_SETS)


@given(st.sampled_from([0x41, 0x61, 0x65, 1]), st.binary(max_size=80))
@settings(max_examples=300, deadline=None)
def test_hostile_slices_are_refused_or_within_bounds(kind, data) -> None:
    try:
        header = slice_header.parse(bytes([kind]) + data, GREY_SETS)
    except ValueError:
        return
    assert 0 <= header.first < 1410 and 0 <= header.frame_num < 16 and 0 <= header.qp <= 51
