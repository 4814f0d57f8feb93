"""A controller library in a process of its own, see `wt_gym.base.processes`; imports the standard library alone."""

import ctypes

MESSAGE_LENGTH = 1025
FAILURES = ()
"""Whatever is raised ends the process."""


class Controller:
    """A library and its function."""

    def __init__(self, path: str, name: str):
        self._function = getattr(ctypes.CDLL(path), name)
        self._function.restype = None

    def call(self, in_file: bytes, out_name: bytes, records: bytes) -> tuple[int, bytes, bytes]:
        """One call: input file name, output name and ``avrSWAP`` in; ``aviFAIL``, message and ``avrSWAP`` out."""
        swap = (ctypes.c_float * (len(records) // 4)).from_buffer_copy(records)
        fail, message = ctypes.c_int32(0), ctypes.create_string_buffer(MESSAGE_LENGTH)
        self._function(swap, ctypes.byref(fail), ctypes.c_char_p(in_file), ctypes.c_char_p(out_name), message)
        return fail.value, message.value, bytes(swap)


begin = Controller
