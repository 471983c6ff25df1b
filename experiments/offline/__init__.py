# SPDX-License-Identifier: BSD-3-Clause
"""Experiments without a network: the streams themselves, and datagrams that are taken out."""
