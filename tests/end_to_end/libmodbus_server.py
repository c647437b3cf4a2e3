"""A Modbus RTU server of libmodbus, run as a program: `libmodbus_server.py PORT BAUD UNIT ADDRESS=WORD..`."""

from __future__ import annotations

import ctypes
import ctypes.util
import sys

RTU_MAX_ADU_BYTES = 260


class Mapping(ctypes.Structure):
    """`modbus_mapping_t` of libmodbus 3.1."""

    _fields_ = (
        ("nb_bits", ctypes.c_int),
        ("start_bits", ctypes.c_int),
        ("nb_input_bits", ctypes.c_int),
        ("start_input_bits", ctypes.c_int),
        ("nb_input_registers", ctypes.c_int),
        ("start_input_registers", ctypes.c_int),
        ("nb_registers", ctypes.c_int),
        ("start_registers", ctypes.c_int),
        ("tab_bits", ctypes.POINTER(ctypes.c_uint8)),
        ("tab_input_bits", ctypes.POINTER(ctypes.c_uint8)),
        ("tab_input_registers", ctypes.POINTER(ctypes.c_uint16)),
        ("tab_registers", ctypes.POINTER(ctypes.c_uint16)),
    )


def library() -> ctypes.CDLL | None:
    """Return libmodbus where this machine has it."""
    path = ctypes.util.find_library("modbus")
    if path is None:
        return None
    modbus = ctypes.CDLL(path, use_errno=True)
    modbus.modbus_new_rtu.restype = ctypes.c_void_p
    modbus.modbus_new_rtu.argtypes = (
        ctypes.c_char_p, ctypes.c_int, ctypes.c_char, ctypes.c_int, ctypes.c_int,
    )  # fmt: skip
    modbus.modbus_mapping_new.restype = ctypes.POINTER(Mapping)
    for name in ("modbus_set_slave", "modbus_connect", "modbus_receive", "modbus_reply"):
        getattr(modbus, name).argtypes = None
    return modbus


def serve(port: str, baud: int, unit: int, words: dict[int, int]) -> None:
    modbus = library()
    assert modbus is not None, "libmodbus is not installed"
    context = ctypes.c_void_p(modbus.modbus_new_rtu(port.encode(), baud, b"E", 8, 1))
    modbus.modbus_set_slave(context, ctypes.c_int(unit))
    if modbus.modbus_connect(context) != 0:
        raise OSError(ctypes.get_errno(), "modbus_connect")
    mapping = modbus.modbus_mapping_new(0, 0, 6000, 6000)  # no coils: they would contradict the words
    for address, word in words.items():
        mapping.contents.tab_registers[address] = word
    print("serving", flush=True)
    request = (ctypes.c_uint8 * RTU_MAX_ADU_BYTES)()
    while True:
        size = modbus.modbus_receive(context, request)
        if size > 0:
            modbus.modbus_reply(context, request, ctypes.c_int(size), mapping)


if __name__ == "__main__":
    path, rate, address, *cells = sys.argv[1:]
    pairs = (cell.split("=") for cell in cells)
    serve(path, int(rate), int(address), {int(key, 0): int(value, 0) for key, value in pairs})
