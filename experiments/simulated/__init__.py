# SPDX-License-Identifier: BSD-3-Clause
"""Experiments in simulated time."""
