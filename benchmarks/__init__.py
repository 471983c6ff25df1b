# SPDX-License-Identifier: BSD-3-Clause
"""The costs and gains of this package, measured beside the usual alternatives: ./smokebot bench."""
