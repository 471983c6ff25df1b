# SPDX-License-Identifier: BSD-3-Clause
"""Slice headers (ITU-T H.264, 7.3.3): read from the network, and written in place of images that were lost.

libavcodec derives the order of images from frame_num. Where the image at which frame_num wraps is lost, it takes the
images behind it for older ones and shows none until it has caught up, for 14 images and more. A receiver that counts
images therefore puts a slice in place of each lost one: all its macroblocks are skipped, so it repeats the last image.
"""
from typing import NamedTuple

from ..wire.bits import BitReader, BitWriter, escaped, unescaped
from . import nal
from .parameter_sets import ParameterSets

MAX_HEADER = 64
"""A slice header is read from this many bytes at most. libx264's have 10 [byte]."""

P, I = 0, 2     # noqa: E741
"""slice_type, modulo 5, table 7-6. Others are not accepted."""

COARSEST = 51
"""Quantiser at which the context of skipped macroblocks is most skewed: they cost least."""

SKIPPED_PER_BYTE = 64
"""Macroblocks that are skipped take a byte of zeros for this many, at most, once the context is adapted; 300 in the
end."""

ADAPTATION = 12
"""Bytes that they take until then, at most."""


class SliceHeader(NamedTuple):
    """What is used of a slice header."""
    first: int
    """Number of its first macroblock."""
    is_idr: bool
    """Whether decoding may begin with its image; its frame_num is 0."""
    frame_num: int
    """Number of its image since the last IDR image, modulo 2 ** frame_num_bits."""
    qp: int
    """Quantiser of its first macroblock, 0..51."""


def parse(unit: bytes, sets: ParameterSets) -> SliceHeader:
    """The header of a slice.

    :param unit: a NAL unit
    :raises ValueError: it is no slice of an image of such parameter sets
    """
    if nal.unit_type(unit) not in nal.SLICES:
        raise ValueError('a NAL unit of type %d is no slice' % nal.unit_type(unit))
    is_idr, is_reference = nal.unit_type(unit) == nal.UnitType.IDR_SLICE, bool(unit[0] >> 5 & 3)
    reader = BitReader(unescaped(unit[1:MAX_HEADER]))
    first = reader.unsigned(sets.macroblocks - 1)
    kind = reader.unsigned(9) % 5
    if kind not in (P, I) or (is_idr and kind == P):
        raise ValueError('a slice is of type %d' % kind)
    if reader.unsigned(255) != sets.picture_id:
        raise ValueError('a slice belongs to other parameter sets')
    frame_num = reader.bits(sets.frame_num_bits)
    if is_idr:
        reader.unsigned(65535)              # idr_pic_id
    if sets.redundant:
        reader.unsigned(0)
    if kind == P:
        _skip_references(reader, sets)
    if is_reference:
        _skip_marking(reader, is_idr)
    if sets.arithmetic and kind == P:
        reader.unsigned(2)                  # cabac_init_idc
    qp = sets.qp + reader.signed(51)
    if not 0 <= qp <= 51:
        raise ValueError('the quantiser of a slice is %d, must be from 0 to 51' % qp)
    return SliceHeader(first, is_idr, frame_num, qp)


def _skip_references(reader: BitReader, sets: ParameterSets) -> None:
    """Skip the fields of a P slice from num_ref_idx_active_override_flag to the weights."""
    references = reader.unsigned(31) + 1 if reader.flag() else sets.references
    if reader.flag():                       # ref_pic_list_modification_flag_l0
        while reader.unsigned(3) != 3:
            reader.unsigned(1 << 16)
    if sets.weighted:
        _skip_weights(reader, references, sets.is_grey)


def _skip_weights(reader: BitReader, references: int, is_grey: bool) -> None:
    """Skip pred_weight_table."""
    planes = [1] if is_grey else [1, 2]
    for _ in planes:
        reader.unsigned(7)                  # log2 of the denominator
    for _ in range(references):
        for weights in planes:
            for _ in range(2 * weights if reader.flag() else 0):
                reader.signed(128)


def _skip_marking(reader: BitReader, is_idr: bool) -> None:
    """dec_ref_pic_marking, without memory management operations"""
    if is_idr:
        reader.bits(2)
    elif reader.flag():
        raise ValueError('a slice has memory management operations')


def lost_slice(sets: ParameterSets, frame_num: int) -> bytes:
    """A NAL unit for an image that was lost: all of it is as in the image before.

    :param frame_num: of the lost image; any number, taken modulo 2 ** frame_num_bits
    """
    writer = BitWriter()
    writer.unsigned(0)                      # first_mb_in_slice
    writer.unsigned(P)
    writer.unsigned(sets.picture_id)
    writer.bits(frame_num % (1 << sets.frame_num_bits), sets.frame_num_bits)
    if sets.redundant:
        writer.unsigned(0)
    writer.bits(0, 2)                       # as many references as usual, in their order
    if sets.weighted:
        planes = 1 if sets.is_grey else 2
        for _ in range(planes):
            writer.unsigned(0)
        writer.bits(0, planes * sets.references)
    writer.bits(0, 1)                       # no memory management operations
    if sets.arithmetic:
        writer.unsigned(0)                  # cabac_init_idc
    writer.signed(COARSEST - sets.qp)
    if sets.deblocking_control:
        writer.unsigned(1)                  # no deblocking
    if sets.arithmetic:
        # the arithmetic decoder reads zeros as the more probable symbol, which is `skipped`, for ever
        data = writer.payload(1) + bytes(ADAPTATION + sets.macroblocks // SKIPPED_PER_BYTE) + b'\x80'
    else:
        writer.unsigned(sets.macroblocks)   # mb_skip_run
        writer.bits(1, 1)
        data = writer.payload(0)
    return bytes([nal.UnitType.SLICE | 2 << 5]) + escaped(data)
