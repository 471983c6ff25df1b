# SPDX-License-Identifier: BSD-3-Clause
"""The fields of a LaserScan, for both sides of scan streams."""

FIXED = ('angle_min', 'angle_max', 'angle_increment', 'time_increment', 'scan_time', 'range_min', 'range_max')
"""The fields of a LaserScan that every segment repeats."""
