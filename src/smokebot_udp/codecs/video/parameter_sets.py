# SPDX-License-Identifier: BSD-3-Clause
"""What an H.264 decoder is told of all images of a session: sequence and picture parameter sets (ITU-T H.264, 7.3.2).

They come from the network. Only what this package's encoder writes is accepted: progressive images of 8 bits, whose
order is that of decoding.
"""
from typing import Dict, NamedTuple, Tuple

from ..wire.bits import BitReader, unescaped
from . import nal

MAX_BYTES = 256
"""Maximum size of both parameter sets together; libx264's have 40 [byte]."""

MAX_MACROBLOCKS = 139264
"""Maximum number of macroblocks of an image, that of level 6.2 (table A-1)."""

MAX_SIDE = 1055
"""Maximum side of an image, that of level 6.2 (A.3.1) [macroblock]."""

HIGH_PROFILES = (100, 110, 122, 244, 44, 83, 86, 118, 128, 138, 139, 134, 135)
"""profile_idc with chroma_format_idc and what follows it, 7.3.2.1.1."""

DECODING_ORDER = 2
"""pic_order_cnt_type: images are shown in the order of decoding. libx264 uses it without B-frames."""


class ParameterSets(NamedTuple):
    """What slice headers depend on."""
    height: int
    """Height of an image, without what is cropped [pixel]."""
    width: int
    """Width of an image, without what is cropped [pixel]."""
    macroblocks: int
    """Number of macroblocks of an image, cropped ones included."""
    is_grey: bool
    """Whether images have no chroma (4:0:0)."""
    frame_num_bits: int
    picture_id: int
    """pic_parameter_set_id"""
    arithmetic: bool
    """Whether the entropy coding is CABAC; else it is CAVLC."""
    references: int
    """num_ref_idx_l0_default_active_minus1 + 1"""
    weighted: bool
    """weighted_pred_flag"""
    qp: int
    """Quantiser that slice_qp_delta adds to."""
    deblocking_control: bool
    redundant: bool
    """redundant_pic_cnt_present_flag"""
    predicted: bool
    """Whether any image may be predicted from another one: max_num_ref_frames"""


class _Sequence(NamedTuple):
    number: int
    height: int
    width: int
    macroblocks: int
    chroma_format: int
    frame_num_bits: int
    predicted: bool


def parse(stream: bytes) -> ParameterSets:
    """Parameter sets as `VideoEncoder` gives them.

    :param stream: one sequence parameter set and one picture parameter set, with start codes
    :raises ValueError: they are anything else, contradict themselves, or exceed a limit
    """
    if len(stream) > MAX_BYTES:
        raise ValueError('the parameter sets have %d bytes, must be at most %d' % (len(stream), MAX_BYTES))
    units: Dict[int, bytes] = {}
    for unit in nal.split(stream):
        if nal.unit_type(unit) in units or nal.unit_type(unit) not in nal.PARAMETER_SETS:
            raise ValueError('beside the parameter sets there is a NAL unit of type %d' % nal.unit_type(unit))
        units[nal.unit_type(unit)] = unescaped(unit[1:])
    if len(units) != len(nal.PARAMETER_SETS):
        raise ValueError('there are %d parameter sets, must be 2' % len(units))
    sequence = _sequence(BitReader(units[nal.UnitType.SEQUENCE_PARAMETERS]))
    return _picture(BitReader(units[nal.UnitType.PICTURE_PARAMETERS]), sequence)


def _sequence(reader: BitReader) -> _Sequence:
    """7.3.2.1.1, up to the cropping."""
    profile = reader.bits(8)
    reader.bits(16)                         # constraints and level
    number = reader.unsigned(31)
    chroma_format = _format(reader) if profile in HIGH_PROFILES else 1
    frame_num_bits = reader.unsigned(12) + 4
    if reader.unsigned(2) != DECODING_ORDER:
        raise ValueError('images are not in the order of decoding')
    predicted = reader.unsigned(16) > 0     # max_num_ref_frames
    reader.flag()                           # gaps_in_frame_num_value_allowed_flag
    columns, rows = reader.unsigned(MAX_SIDE - 1) + 1, reader.unsigned(MAX_SIDE - 1) + 1
    if rows * columns > MAX_MACROBLOCKS:
        raise ValueError('an image has %d macroblocks, must have at most %d' % (rows * columns, MAX_MACROBLOCKS))
    if not reader.flag():
        raise ValueError('images are interlaced')
    reader.flag()                           # direct_8x8_inference_flag
    height, width = _cropped(reader, 16 * rows, 16 * columns, chroma_format)
    return _Sequence(number, height, width, rows * columns, chroma_format, frame_num_bits, predicted)


def _format(reader: BitReader) -> int:
    """chroma_format_idc: grey or 4:2:0, of 8 bits, without scaling matrices."""
    chroma_format = reader.unsigned(1)
    reader.unsigned(0)                      # bit_depth_luma_minus8
    reader.unsigned(0)                      # bit_depth_chroma_minus8
    reader.flag()                           # qpprime_y_zero_transform_bypass_flag
    if reader.flag():
        raise ValueError('there are scaling matrices')
    return chroma_format


def _cropped(reader: BitReader, height: int, width: int, chroma_format: int) -> Tuple[int, int]:
    """The size of an image once it is cropped."""
    if not reader.flag():
        return height, width
    unit = 2 if chroma_format else 1
    left, right, top, bottom = (unit * reader.unsigned(16 * MAX_SIDE) for _ in range(4))
    if left or top or right >= width or bottom >= height:
        raise ValueError('%d, %d, %d, %d rows and columns are cropped of an image of %d x %d' % (
            top, bottom, left, right, height, width))
    return height - bottom, width - right


def _picture(reader: BitReader, sequence: _Sequence) -> ParameterSets:
    """7.3.2.2, up to redundant_pic_cnt_present_flag."""
    number = reader.unsigned(255)
    if reader.unsigned(31) != sequence.number:
        raise ValueError('the picture parameter set belongs to another sequence')
    arithmetic = reader.flag()
    reader.flag()                           # bottom_field_pic_order_in_frame_present_flag
    reader.unsigned(0)                      # num_slice_groups_minus1
    references = reader.unsigned(31) + 1
    reader.unsigned(31)                     # num_ref_idx_l1_default_active_minus1
    weighted = reader.flag()
    reader.bits(2)                          # weighted_bipred_idc
    qp = 26 + reader.signed(26)
    if not 0 <= qp <= 51:
        raise ValueError('the quantiser is %d, must be from 0 to 51' % qp)
    reader.signed(26)                       # pic_init_qs_minus26
    reader.signed(12)                       # chroma_qp_index_offset
    deblocking_control = reader.flag()
    reader.flag()                           # constrained_intra_pred_flag
    return ParameterSets(
        sequence.height, sequence.width, sequence.macroblocks, not sequence.chroma_format, sequence.frame_num_bits,
        number, arithmetic, references, weighted, qp, deblocking_control, reader.flag(),
        sequence.predicted)
