# SPDX-License-Identifier: BSD-3-Clause
"""CSV files of rows with named columns."""
import csv
import pathlib
from typing import Any, Dict, Iterable, List

Row = Dict[str, Any]
"""{column: text, number, bool or None}"""


def write(path: pathlib.Path, rows: Iterable[Row]) -> None:
    """Write at least one row; all have the same columns."""
    rows = list(rows)
    with open(str(path), 'w', newline='') as file:
        writer = csv.DictWriter(file, rows[0].keys())
        writer.writeheader()
        writer.writerows(rows)


def read(path: pathlib.Path) -> List[Row]:
    """The rows as they were written: a text that looks like a number is one, an empty one is None."""
    with open(str(path), newline='') as file:
        return [{key: _value(text) for key, text in row.items()} for row in csv.DictReader(file)]


def _value(text: str) -> Any:
    if not text:
        return None
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return {'True': True, 'False': False}.get(text, text)
