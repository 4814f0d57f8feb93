"""A process that holds one library: what it does to the process, a crash included, does not reach the simulation.

Runs as a script with the path of the library and the name of its function, and imports nothing but the standard
library. A request on standard input is the input file name, the output name and ``avrSWAP``, each with its length in
front (little-endian, 4 bytes); the answer on standard output the flag ``aviFAIL`` (4 bytes), the message and
``avrSWAP``. What the library itself prints goes to standard error.
"""

import ctypes
import os
import struct
import sys
from collections.abc import Sequence
from typing import IO, Any

MESSAGE_LENGTH = 1025


def call(function: Any, parts: Sequence[bytes]) -> tuple[bytes, bytes, bytes]:
    """One call: input file name, output name and records in, flag, message and records out."""
    in_file, out_name, records = parts
    swap = (ctypes.c_float * (len(records) // 4)).from_buffer_copy(records)
    fail, message = ctypes.c_int32(0), ctypes.create_string_buffer(MESSAGE_LENGTH)
    function(swap, ctypes.byref(fail), ctypes.c_char_p(in_file), ctypes.c_char_p(out_name), message)
    return struct.pack("<i", fail.value), message.value, bytes(swap)


def read_part(stream: IO[bytes]) -> bytes | None:
    """One part of a request, None where there are no more."""
    head = stream.read(4)
    return stream.read(struct.unpack("<I", head)[0]) if len(head) == 4 else None


def main(path: str, name: str) -> None:
    """Answer requests until there are no more."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # prints of the library
    function = getattr(ctypes.CDLL(path), name)
    function.restype = None
    while True:
        parts = [part for _ in range(3) if (part := read_part(sys.stdin.buffer)) is not None]
        if len(parts) < 3:
            return
        for part in call(function, parts):
            answers.write(struct.pack("<I", len(part)) + part)
        answers.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
