# SPDX-License-Identifier: BSD-3-Clause
"""What this package costs and gains, measured beside what one would use instead: ./smokebot bench."""
