# SPDX-License-Identifier: BSD-3-Clause
"""A sealed link under attack: images go on, and nothing of the stranger's is taken."""
import dataclasses
import json
import pathlib
from typing import Any, Dict, List, Union

from evaluation.hostile_link import IMAGE_RATE, SIDES, HostileLink, Phase
from evaluation.kept_memory import KEPT, QUICK_KEPT

from ..runner import Figure, Run, Table

TITLE = 'A sealed link under attack'

EXPLANATION = """
Robot and operator have a master each, and a link with a key; the robot has two addresses, over two links. A stranger
hears all that crosses, and sends from any address: 10 000 handshakes that it does not end, each from an address of its
own; a million bad datagrams to each end of both links, 20 000 a second, as far as the machine allows: random ones,
mutated, cut and prolonged ones, forged data, good ones again, from the true sender's address or another, and reflected
ones. Then an operator with another key tries to join.
"""

COUNT, QUICK_COUNT = 10 ** 6, 10 ** 5
RATE = 20000.0
"""[1/s]"""

HALF_OPEN, QUICK_HALF_OPEN = 10 ** 4, 10 ** 3
MIN_RATE = 0.95 * IMAGE_RATE
"""[Hz]"""

MAX_GROWTH = 10e6
"""[byte]"""


def run(run: Run) -> None:
    """Write phases.json."""
    quick = run.quick
    with HostileLink(run.folder, QUICK_COUNT if quick else COUNT, RATE, QUICK_HALF_OPEN if quick else HALF_OPEN,
                     run.seed, QUICK_KEPT if quick else KEPT) as link:
        phases = [dataclasses.asdict(phase) for phase in link.phases()]
    (run.folder / 'phases.json').write_text(json.dumps(phases, indent=1))


def load(folder: pathlib.Path) -> List[Phase]:
    """The phases that were measured."""
    return [Phase(**values) for values in json.loads((folder / 'phases.json').read_text())]


def missed(folder: pathlib.Path) -> List[str]:
    """Goals that were missed."""
    phases = load(folder)
    slow = ['%s: %.1f images a second' % (phase.name, phase.rate) for phase in phases if phase.rate < MIN_RATE]
    grown = ['%s: %s grew by %.1f MB' % (phase.name, side, 1e-6 * phase.growth[side])
             for phase in phases for side in SIDES if phase.growth[side] > MAX_GROWTH]
    return slow + grown


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """Tables of the phases, and of what was sent and dropped."""
    return [images_table(folder), dropped_table(folder)]


def images_table(folder: pathlib.Path) -> Table:
    """Images and memory in each phase."""
    return Table('Images at the operator, and growth of the nodes\' memory:',
                 ['attack', 'seconds', 'images [Hz]', 'age p99 [ms]', 'robot + [MB]', 'operator + [MB]'],
                 [[phase.name, '%.0f' % phase.seconds, '%.1f' % phase.rate, '%.0f' % (1e3 * phase.age),
                   *('%+.1f' % (1e-6 * phase.growth[side]) for side in SIDES)] for phase in load(folder)])


def dropped_table(folder: pathlib.Path) -> Table:
    """What was sent and dropped in each phase."""
    return Table('What the stranger sent, and what the attacked node dropped:', ['attack', 'sent', 'dropped'],
                 [[phase.name, in_words(phase.sent), in_words(phase.dropped)] for phase in load(folder)])


DOC_TABLES = {'images': images_table, 'dropped': dropped_table}


def in_words(counts: Dict[str, Any]) -> str:
    """'7 of this, 5 of that', most first."""
    return ', '.join('%s: %d' % item for item in sorted(counts.items(), key=lambda item: -item[1]))
