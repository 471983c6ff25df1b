# SPDX-License-Identifier: BSD-3-Clause
"""Layered images: an embedded wavelet stream of which any prefix is an image (doc/layered_images.md).

Its loops are compiled by numba, which only these modules import: it costs 1 s and 100 MB at the first import.
"""
