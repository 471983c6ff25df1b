# SPDX-License-Identifier: BSD-3-Clause
"""The warning thresholds of a stream's diagnostics."""
import math
from dataclasses import dataclass, fields, replace
from typing import Any, List, Mapping, Tuple


@dataclass(frozen=True)
class Thresholds:
    """See doc/parameters.md for each threshold's meaning."""
    warn_loss: float = 0.3
    """Ratio, 0..1."""
    error_loss: float = 0.7
    warn_completeness: float = 0.5
    """Ratio, 0..1."""
    warn_psnr: float = 20.0
    """[dB]"""
    warn_error: float = 100.0
    """[values of pixels]"""
    warn_age: float = 0.5
    """[s]"""
    error_age: float = 2.0
    error_silence: float = 2.0
    """[s]"""

    def override(self, values: Mapping[str, Any]) -> Tuple['Thresholds', List[str]]:
        """Replace the thresholds that `values` names.

        :param values: {name: value} from the parameter server; other names are ignored
        :return: (thresholds, problems); a value that is not a finite number >= 0 is a problem and changes nothing
        """
        good, problems = {}, []
        for name in (field.name for field in fields(self)):
            value = values.get(name, 0.0)
            is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
            if not is_number or not math.isfinite(value) or value < 0:
                problems.append('%s is %r, must be a number from 0: %g is used' % (name, value, getattr(self, name)))
            elif name in values:
                good[name] = float(value)
        return replace(self, **good), problems
