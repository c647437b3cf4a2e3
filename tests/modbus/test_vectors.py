"""The telegrams that the manuals print, byte for byte (tests/vectors/manuals.toml)."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

from gateway.errors import BadFrameError
from gateway.modbus import adu
from gateway.modbus.device_id import DeviceIdentification
from gateway.modbus.pdu import encode_exception, exception_code
from gateway.modbus.server import decode_request
from tests.modbus.request_size import request_adu_size
from tests.modbus.samples import CLASSES, reply_of

_FILE = Path(__file__).parent.parent / "vectors" / "manuals.toml"
VECTORS: list[dict[str, Any]] = tomllib.loads(_FILE.read_text(encoding="utf-8"))["vector"]

every_vector = pytest.mark.parametrize("vector", VECTORS, ids=lambda vector: vector["id"])
every_misprint = pytest.mark.parametrize(
    "vector", [vector for vector in VECTORS if "reply_printed" in vector], ids=lambda vector: vector["id"]
)


NAMED = {each.__name__: each for each in CLASSES.values()}
NOT_ASKED = {"kind", "value", "objects", "exception", "conformity"}  # fields of the reply


def request_of(says: dict[str, Any]) -> Any:
    fields = {key: tuple(each) if isinstance(each, list) else each for key, each in says.items()}
    return NAMED[says["kind"]](**{key: each for key, each in fields.items() if key not in NOT_ASKED})


def value_of(says: dict[str, Any]) -> Any:
    """What `decode_reply` is to return: words or bits, an identification, None for a write."""
    if "objects" in says:
        return DeviceIdentification(objects={int(key): text for key, text in says["objects"].items()})
    return tuple(says["value"]) if "value" in says else None


def replied(says: dict[str, Any]) -> bytes:
    request = request_of(says)
    if "exception" in says:
        return encode_exception(request.function, says["exception"])
    if "conformity" in says:
        pdu: bytes = request.encode_reply(value_of(says), conformity=says["conformity"])
        return pdu
    return reply_of(request, value_of(says))


@every_vector
def test_a_request_is_encoded_and_understood_as_the_manual_prints_it(vector: dict[str, Any]) -> None:
    printed, request = bytes.fromhex(vector["request"]), request_of(vector["says"])

    assert adu.encode(printed[0], request.encode()) == printed
    assert decode_request(adu.decode(printed).pdu) == request
    assert request_adu_size(printed) == len(printed)


@every_vector
def test_a_reply_is_encoded_and_says_what_the_manual_prints(vector: dict[str, Any]) -> None:
    says, printed = vector["says"], bytes.fromhex(vector["reply"])
    request, (unit, pdu) = request_of(says), adu.decode(printed)

    assert adu.encode(unit, replied(says)) == printed
    assert exception_code(request, pdu) == says.get("exception")
    if "exception" not in says:
        assert request.decode_reply(pdu) == value_of(says)


@every_misprint
def test_a_misprinted_reply_with_the_crc_corrected_still_says_what_is_meant(vector: dict[str, Any]) -> None:
    says, printed = vector["says"], bytes.fromhex(vector["reply_printed"])
    with pytest.raises(BadFrameError):
        adu.decode(printed)

    _, pdu = adu.decode(adu.encode(printed[0], printed[1:-2]))

    assert request_of(says).decode_reply(pdu) == value_of(says)
