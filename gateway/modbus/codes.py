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
    ENCAPSULATED = 43


class ExceptionCode(enum.IntEnum):
    """Why a unit refuses a request, in the specification's words [APP 7]."""

    ILLEGAL_FUNCTION = 1
    ILLEGAL_DATA_ADDRESS = 2
    ILLEGAL_DATA_VALUE = 3
    SERVER_DEVICE_FAILURE = 4  # the SST: the reply would be longer than its 54 bytes (sst-intecma NOTES)
    ACKNOWLEDGE = 5
    SERVER_DEVICE_BUSY = 6  # the SST lists it without a word (sst-intecma, after FC6)
    MEMORY_PARITY_ERROR = 8
    GATEWAY_PATH_UNAVAILABLE = 10
    GATEWAY_TARGET_DEVICE_FAILED_TO_RESPOND = 11


def exception_name(code: int) -> str:
    """Return the specification's words for an exception code; an unknown one is shown by its number."""
    try:
        return ExceptionCode(code).name.lower().replace("_", " ")
    except ValueError:
        return f"exception {code}"
