# SPDX-License-Identifier: BSD-3-Clause
"""The results of experiments as CSV files, see evaluation/csv_rows.py."""
from evaluation.csv_rows import Row, read, write

__all__ = ['Row', 'read', 'write']
