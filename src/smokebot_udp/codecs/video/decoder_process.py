# SPDX-License-Identifier: BSD-3-Clause
"""The process that decodes the video of one stream: `python3 -m smokebot_udp.codecs.video.decoder_process MEMORY`.

MEMORY is the number of the file descriptor of the memory that it shares with its node, see decoder_memory.py. It reads
commands from its standard input, answers them on its standard output, and ends with its input. It parses bytes from the
air: before the first one it gives up what it does not need.
"""
import mmap
import os
import resource
import sys
from typing import Any

from . import nal
from .decoder_memory import COMMAND, PLANES, PLANES_AT, SIZE, Answer, Command, Status, layout
from .decoder_request import Request

HEADROOM = 256 << 20
"""Memory that it may map beyond what its libraries take [byte]. An image of MAX_PIXELS takes 6 MB, and libavcodec keeps
a few of them."""

COMMANDS, ANSWERS, STDERR = 0, 1, 2
"""File descriptors."""


def main(*arguments: str) -> int:
    """Decode until the node closes the pipe."""
    memory = mmap.mmap(int(arguments[0]), SIZE)
    os.close(int(arguments[0]))
    try:
        from .decoder import Decoder
        decoder = Decoder()
        decoder.test()
    except Exception as error:      # PyAV of another Python, a missing library, ...
        memory[PLANES_AT:PLANES_AT + 256] = ('%s: %s' % (type(error).__name__, error)).encode()[:255].ljust(256, b'\0')
        _answer(Answer(0, Status.BROKEN))
        return 1
    _give_up()
    _answer(Answer(0, Status.READY))
    while True:
        data = os.read(COMMANDS, COMMAND.size)
        if not data:
            return 0
        command = Command.from_bytes(data)
        try:
            answer = _decode(decoder, memory, command)
        except (ValueError, IndexError):    # IndexError: planes of another size than expected
            answer = Answer(command.number, Status.UNFIT)
        except MemoryError:
            answer = Answer(command.number, Status.NOTHING)
        _answer(answer)


def _decode(decoder: Any, memory: mmap.mmap, command: Command) -> Answer:
    """Decode one image into the memory.

    :raises ValueError: see Decoder.decode; or the planes do not fit the memory
    """
    end = command.sets_size + command.slices_size
    picture = decoder.decode(Request(
        command.session, command.height, command.width, command.colour, memory[:command.sets_size],
        nal.split(memory[command.sets_size:end])))
    if picture is None:
        return Answer(command.number, Status.NOTHING)
    for plane, lines in zip(layout(picture.height, picture.width, picture.lines), picture.planes):
        memory[plane.start:plane.end] = lines[:plane.end - plane.start]
    return Answer(command.number, Status.DECODED, picture.height, picture.width,
                  (*picture.lines, 0, 0)[:PLANES])


def _answer(answer: Answer) -> None:
    os.write(ANSWERS, answer.to_bytes())


def _give_up() -> None:
    """No messages, no files, no processes, no core dump, and little memory from now on."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, STDERR)
    os.close(nowhere)
    with open('/proc/self/statm') as file:
        mapped = int(file.read().split()[0]) * mmap.PAGESIZE
    for what, limit in ((resource.RLIMIT_AS, mapped + HEADROOM), (resource.RLIMIT_NOFILE, 0),
                        (resource.RLIMIT_FSIZE, 0), (resource.RLIMIT_NPROC, 0), (resource.RLIMIT_CORE, 0)):
        resource.setrlimit(what, (limit, limit))


if __name__ == '__main__':
    sys.exit(main(*sys.argv[1:]))
