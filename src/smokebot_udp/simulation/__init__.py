# SPDX-License-Identifier: BSD-3-Clause
"""A burning building and a robot in it, modelled once: every sensor sees the same walls. Needs no ROS."""
