# SPDX-License-Identifier: BSD-3-Clause
"""The deliverable's experiments, done again with this package: ./smokebot experiments."""
