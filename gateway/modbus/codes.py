"""The numbers of Modbus: function codes [APP 5.1, 6] and exception codes [APP 7]."""

from __future__ import annotations

import enum

EXCEPTION_BIT = 0x80  # set in the function of an exception reply [APP 4.1]
MEI_DEVICE_IDENTIFICATION = 14  # the one encapsulated interface in use [APP 6.21]


class Function(enum.IntEnum):
    """The functions that this gateway and its simulator know."""

    READ_COILS = 1
    READ_DISCRETE_INPUTS = 2
    READ_HOLDING_REGISTERS = 3
    READ_INPUT_REGISTERS = 4
    WRITE_COIL = 5
    WRITE_REGISTER = 6
    WRITE_COILS = 15
    WRITE_REGISTERS = 16
    MASK_WRITE_REGISTER = 22
    READ_WRITE_REGISTERS = 23
    ENCAPSULATED = 43


class ExceptionCode(enum.IntEnum):
    """Why a unit refuses a request [APP 7]."""

    ILLEGAL_FUNCTION = 1
    ILLEGAL_DATA_ADDRESS = 2
    ILLEGAL_DATA_VALUE = 3
    SERVER_DEVICE_FAILURE = 4  # the SST: the reply would be longer than its 54 bytes (sst-intecma NOTES)
    ACKNOWLEDGE = 5
    SERVER_DEVICE_BUSY = 6  # the SST lists it without a word (sst-intecma, after FC6)
    MEMORY_PARITY_ERROR = 8
    GATEWAY_PATH_UNAVAILABLE = 10
    GATEWAY_TARGET_SILENT = 11


_NAMES = {
    ExceptionCode.ILLEGAL_FUNCTION: "illegal function",
    ExceptionCode.ILLEGAL_DATA_ADDRESS: "illegal data address",
    ExceptionCode.ILLEGAL_DATA_VALUE: "illegal data value",
    ExceptionCode.SERVER_DEVICE_FAILURE: "server device failure",
    ExceptionCode.ACKNOWLEDGE: "acknowledge",
    ExceptionCode.SERVER_DEVICE_BUSY: "server device busy",
    ExceptionCode.MEMORY_PARITY_ERROR: "memory parity error",
    ExceptionCode.GATEWAY_PATH_UNAVAILABLE: "gateway path unavailable",
    ExceptionCode.GATEWAY_TARGET_SILENT: "gateway target device failed to respond",
}


def exception_name(code: int) -> str:
    """Return the specification's words for an exception code; an unknown one is shown by its number."""
    try:
        return _NAMES[ExceptionCode(code)]
    except ValueError:
        return f"exception {code}"
