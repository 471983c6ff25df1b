# SPDX-License-Identifier: BSD-3-Clause
"""H.264 in slices of one datagram each, protected by an erasure code over the slices of an image (doc/video.md).

libx264 and libavcodec are used through PyAV, which only `encoder` and the decoder's own process import.
"""
