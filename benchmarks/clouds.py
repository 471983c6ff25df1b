# SPDX-License-Identifier: BSD-3-Clause
"""Point clouds in each encoding: bytes a point, time, and how evenly loss thins them; beside Draco.

Clouds are the simulated LiDAR's and recordings, with one point for each voxel of 0.1 m, as streams.yaml has it, and one
not reduced. Draco (https://google.github.io/draco) codes a cloud as a whole, with the same steps; it is left out where
DracoPy is not installed (./smokebot exec pip install DracoPy).
"""
import collections
import importlib.util
import statistics
import time
from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple

import numpy as np

from evaluation.clouds import distance, message_of, points_of
from evaluation.offline_link import Receiver, Sender, wire_size
from evaluation.recordings import RECORDINGS, cloud_points
from smokebot_udp.arrays import Float32Array
from smokebot_udp.codecs.perception.voxel import voxel_filter
from smokebot_udp.simulation.lidar import Lidar
from smokebot_udp.simulation.world import building

ENCODINGS = 'float32', 'packed', 'sorted'
LEAF, BOUND = 0.1, 0.0125
"""As in streams.yaml [m]."""

RECORDED = 'vlp16_einride_indoor_10hz', 'seq_os0-8_moving', 'seq_os1-128'
"""Folders of recordings."""

UNREDUCED = 'simulated, not reduced'
DRACO, DRACO_BITS, DRACO_LEVEL = 'Draco, whole', 20, 7
"""Bits of each coordinate at most, and the level of its command line's default [0..10]."""

MISSING = 'DracoPy is not installed'
ROUNDS, QUICK_ROUNDS = 15, 3
DRAWS = 4
"""How often half of the datagrams are drawn."""

Row = Dict[str, Optional[float]]


def clouds() -> Dict[str, List[Float32Array]]:
    """{kind: clouds}, each (n, 3) points [m]."""
    scan = Lidar(building(1), 0.9, 1).scan((1.5, 7.0, 0.3), 0.0)
    simulated = np.stack([scan[axis] for axis in 'xyz'], axis=1)
    found = collections.defaultdict(list, {UNREDUCED: [simulated], 'simulated': [voxel_filter(simulated, LEAF)[0]]})
    for folder in RECORDED:
        for path in sorted(RECORDINGS.joinpath('lidar', folder).glob('scan*')):
            points = cloud_points(path)
            found[folder].append(voxel_filter(points[points.any(axis=1)], LEAF)[0])    # (0, 0, 0): no return
    return found


def timed(function: Callable[[], Any], rounds: int) -> Tuple[float, Any]:
    """The least processor time of a function, and its result [s]."""
    times = []
    for _ in range(rounds + 1):
        begun = time.process_time()
        result = function()
        times.append(time.process_time() - begun)
    return min(times[1:]), result


def ours(encoding: str, xyz: Float32Array, rounds: int) -> Row:
    """A cloud by this package, without its voxel grid filter."""
    message, receiver = message_of(xyz), Receiver('cloud')
    encode, frames = timed(lambda: Sender('cloud', leaf_size=0.0, encoding=encoding, error_bound=BOUND).frames(message),
                           rounds)
    records = [frame.records for frame in frames]
    decode, shown = timed(lambda: receiver.assemble(records), rounds)
    assert shown.width == len(xyz)
    (segments,), whole, draws = records, points_of(shown), np.random.RandomState(1)
    halves = [points_of(receiver.assemble([segments[draws.permutation(len(segments)) < -(-len(segments) // 2)]]))
              for _ in range(DRAWS)]
    data = sum(len(part) * (part['data'].shape[1] + part['codes'].shape[1]) for part in records)
    return {'bytes a point': data / len(xyz), 'with heads': wire_size(frames) / len(xyz),
            'datagrams': float(sum(map(len, records))), 'encode [ms]': 1e3 * encode, 'decode [ms]': 1e3 * decode,
            'half lost: p99 [m]': statistics.mean(distance(whole, half) for half in halves)}


def draco(xyz: Float32Array, rounds: int) -> Row:
    """A cloud by Draco, as one piece, with the same steps."""
    import DracoPy
    step = 2 * BOUND
    low = (np.floor(xyz.min(axis=0) / step) * step).astype(np.float64)
    bits = min(DRACO_BITS, int(np.ceil((xyz.max(axis=0) - low).max() / step)).bit_length())
    encode, data = timed(lambda: DracoPy.encode(
        xyz, quantization_bits=bits, compression_level=DRACO_LEVEL, quantization_range=step * ((1 << bits) - 1),
        quantization_origin=low), rounds)
    decode, shown = timed(lambda: DracoPy.decode(data), rounds)
    assert len(shown.points) == len(xyz)
    return {'bytes a point': len(data) / len(xyz), 'with heads': None, 'datagrams': None, 'encode [ms]': 1e3 * encode,
            'decode [ms]': 1e3 * decode, 'half lost: p99 [m]': None}


def mean(rows: List[Row]) -> Row:
    """The means of rows, None where one has none."""
    means: Row = {}
    for key in rows[0]:
        values = [row[key] for row in rows]
        means[key] = None if None in values else statistics.mean(value for value in values if value is not None)
    return means


def run(log: Callable[[str], None], quick: bool = False) -> Dict[str, Any]:
    """{'clouds': {kind: {method: means of its clouds}}, 'points': {kind: mean number}, 'skipped': {method: why}}."""
    rounds, has_draco = QUICK_ROUNDS if quick else ROUNDS, importlib.util.find_spec('DracoPy') is not None
    results: Dict[str, Any] = {'clouds': {}, 'points': {}, 'skipped': {} if has_draco else {DRACO: MISSING}}
    for kind, found in clouds().items():
        log(kind)
        found = found[:1] if quick else found
        methods = {encoding: mean([ours(encoding, xyz, rounds) for xyz in found]) for encoding in ENCODINGS}
        if has_draco:
            methods[DRACO] = mean([draco(xyz, rounds) for xyz in found])
        results['clouds'][kind] = methods
        results['points'][kind] = statistics.mean(map(len, found))
    return results


def table(results: Mapping[str, Any]) -> str:
    """The results as text."""
    head = ['cloud', 'points', 'encoding', 'bytes a point', 'with heads', 'datagrams', 'encode [ms]', 'decode [ms]',
            'half lost: p99 [m]']
    rows = [head, ['---'] * len(head)]
    for kind, methods in results['clouds'].items():
        for method, row in methods.items():
            values = ['–' if row[key] is None else '%.*f' % (0 if key == 'datagrams' else 2, row[key])
                      for key in head[3:]]
            rows.append([kind, '%.0f' % results['points'][kind], method, *values])
    lines = ['point clouds, mean of the clouds of each kind, least processor time', '']
    lines += ['| ' + ' | '.join(cells) + ' |' for cells in rows]
    lines += ['%s is left out: %s' % item for item in results['skipped'].items()]
    return '\n'.join(lines)
