#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Hostile bytes for the decoder of map tiles.

    NUMBA_BOUNDSCHECK=1 NUMBA_CACHE_DIR=$(mktemp -d) ./smokebot exec python3 test/fuzz/fuzz_tiles.py [TILES [SEED]]

The environment makes numba's loops check their indexes, see fuzz_layered.py. Tiles of good maps are mutated, cut,
prolonged, given other sizes; others are random. Any exception but ValueError is a fault, as are values beyond -1..100,
a tile that takes more than MAX_TIME of processor time, and a good tile that is not decoded to its cells.
"""
import collections
import pathlib
import sys
import time
from random import Random
from typing import Any, Counter, List, NamedTuple

import numpy as np

sys.path[:0] = [str(pathlib.Path(__file__).resolve().parents[2]), str(pathlib.Path(__file__).resolve().parent)]
from fuzzing import run  # noqa: E402

from smokebot_udp.codecs.tiles.coder import MAX_CELLS, decode, encode  # noqa: E402

MAX_TIME = 1.0
"""Maximum time for a tile of MAX_CELLS with checked indexes. Without checks it takes a fifth [s]."""
TILES = 1000000
SHAPES = (1, 1), (1, 90), (70, 2), (20, 30), (61, 83), (128, 128)
HOSTILE_SHAPES = (0, 3), (-1, 5), (1, MAX_CELLS + 1), (1 << 40, 1 << 40)
RARELY = 0.0005
"""Probability of a tile of MAX_CELLS."""
BATCH = 100


class Good(NamedTuple):
    """A good tile."""
    data: bytes
    cells: Any


def good_tiles(random: Any) -> List[Good]:
    """Tiles of all kinds: rooms, costs, noise."""
    tiles = []
    for height, width in SHAPES:
        rooms = np.full((height, width), -1, np.int8)
        rooms[height // 4:, width // 5:] = 0
        rooms[height // 4, :] = rooms[:, width // 5] = 100
        costs = np.minimum(np.add.outer(np.arange(height), 2 * np.arange(width)) // 3, 100).astype(np.int8)
        for cells in (rooms, costs, random.randint(-1, 101, (height, width)).astype(np.int8),
                      random.choice([-1, 0, 100], (height, width)).astype(np.int8)):
            data = encode(cells, 1 << 20)
            assert data is not None
            tiles.append(Good(data, cells))
    return tiles


class Fuzzer:
    """Feeds tiles to the decoder.

    :param random: of all that is random
    """

    def __init__(self, random: Random) -> None:
        self._random, self._numpy = random, np.random.RandomState(random.randrange(1 << 30))
        self._tiles = good_tiles(self._numpy)
        self.inputs, self.worst = 0, 0.0
        self.outcomes: Counter[str] = collections.Counter()
        """Number of tiles that were decoded, and that were refused, by the words of the reason."""

    def report(self) -> str:
        """What became of the tiles."""
        return str(dict(self.outcomes))

    def good(self) -> None:
        """Decode the good tiles, which compiles all loops."""
        for tile in self._tiles:
            cells = decode(np.frombuffer(tile.data, np.uint8), *tile.cells.shape)
            assert (cells == tile.cells).all()

    def batch(self) -> None:
        """Decode some others."""
        for _ in range(BATCH):
            self._one()
        self.inputs += BATCH

    def _one(self) -> None:
        random, tile = self._random, self._random.choice(self._tiles)
        data = self._mutated(tile.data) if random.random() < 0.8 else bytes([random.choice((101, 102, 103, 104))]) + (
            self._numpy.bytes(random.choice((0, 1, 7, 60, 1330))))
        height, width = self._shape(tile.cells.shape)
        begun = time.process_time()
        try:
            cells = decode(np.frombuffer(data, np.uint8), height, width)
        except ValueError as error:
            self.outcomes[' '.join(word for word in str(error).split() if word.isalpha())] += 1
        else:
            self.outcomes['decoded'] += 1
            assert cells.shape == (height, width) and cells.min() >= -1 and cells.max() <= 100
        self.worst = max(self.worst, time.process_time() - begun)

    def _shape(self, shape: Any) -> Any:
        chance = self._random.random()
        if chance < RARELY:
            return self._random.choice(((1 << 10, 1 << 10), (1, MAX_CELLS), (MAX_CELLS, 1)))
        if chance < 0.05:
            return self._random.choice(HOSTILE_SHAPES)
        return self._random.choice(SHAPES) if chance < 0.2 else shape

    def _mutated(self, good: bytes) -> bytes:
        random, data = self._random, bytearray(good)
        for _ in range(random.choice((0, 1, 1, 2, 10))):
            data[random.randrange(len(data))] = random.choice((0, 1, 127, 255, random.randrange(256)))
        if random.random() < 0.2:
            del data[random.randrange(len(data)):]
        elif random.random() < 0.2:
            data += self._numpy.bytes(random.choice((1, 5, 6, 7, 100)))
        return bytes(data)


if __name__ == '__main__':
    tiles, seed = [int(argument) for argument in sys.argv[1:]] + [TILES, 1][len(sys.argv) - 1:]
    sys.exit(run(Fuzzer(Random(seed)), tiles, MAX_TIME))
