# SPDX-License-Identifier: BSD-3-Clause
"""An emulated bad link between two network namespaces of one machine. Does not need rospy."""
