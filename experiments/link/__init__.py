# SPDX-License-Identifier: BSD-3-Clause
"""Experiments over the emulated link of a link lab, with all nodes running; they need root."""
