# SPDX-License-Identifier: BSD-3-Clause
"""YAML as the package's files use it: whatever is wrong with a text becomes problems in words, never another exception.
"""
from typing import Any, List, Tuple

import yaml


class _Loader(yaml.SafeLoader):
    """YAML that reports a key given twice; the first one counts."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self.repeated: List[Tuple[str, int]] = []   # (key, line), in the order of the file

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        seen, pairs = set(), []
        for key, value in node.value:
            scalar = isinstance(key, yaml.ScalarNode)   # any other key is an error of PyYAML's, which names its place
            if scalar and key.value in seen:
                self.repeated.append((key.value, key.start_mark.line + 1))
            else:
                seen.update([key.value] if scalar else [])
                pairs.append((key, value))
        node.value = pairs
        return super().construct_mapping(node, deep)


def read_yaml(text: str) -> Tuple[Any, List[str]]:
    """Read the text of a file.

    :return: (the document, None if it is not valid; [problem, ...] in words)
    """
    try:
        loader = _Loader(text)
        document = loader.get_single_data()
    except Exception as error:  # besides its own, PyYAML raises others: for 2001-13-45 (a date), !!bool x, [[[[...
        return None, ['not valid YAML: %s' % (' '.join(str(error).split()) or type(error).__name__)]
    return document, ['%r is given twice, again in line %d: the first one counts' % repeated
                      for repeated in loader.repeated]
