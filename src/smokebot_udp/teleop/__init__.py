# SPDX-License-Identifier: BSD-3-Clause
"""Driving over a bad link: commands that expire, who drives, the emergency stop. Pure: times are arguments [s]."""
