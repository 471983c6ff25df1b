# SPDX-License-Identifier: BSD-3-Clause
"""A burning building with a robot in it: one model, which all simulated sensors share. Does not need ROS."""
