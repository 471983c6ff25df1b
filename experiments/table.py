# SPDX-License-Identifier: BSD-3-Clause
"""Rows of numbers and texts in CSV files."""
import csv


def write(path, rows):
    """:param rows: dicts of the same keys, one at least"""
    rows = list(rows)
    with open(str(path), 'w', newline='') as file:
        writer = csv.DictWriter(file, rows[0].keys())
        writer.writeheader()
        writer.writerows(rows)


def read(path):
    """The rows as they were written: what looks like a number is one, what is empty is None."""
    with open(str(path), newline='') as file:
        return [{key: _value(text) for key, text in row.items()} for row in csv.DictReader(file)]


def _value(text):
    if not text:
        return None
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return {'True': True, 'False': False}.get(text, text)
