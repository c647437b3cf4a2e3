"""The telegrams that the manuals print, answered byte for byte (tests/vectors/manuals.toml)."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from gateway.modbus.adu import decode, encode
from gateway.sim.factory import make_unit
from tests.sim.wire import Talk

VECTORS = tomllib.loads((Path(__file__).parents[1] / "vectors" / "manuals.toml").read_text("utf-8"))["vector"]
FIRMWARE = {"ssw06": "1.11", "ssw07": "1.20"}


@pytest.mark.parametrize("vector", VECTORS, ids=lambda vector: vector["id"])
def test_a_starter_answers_as_in_its_manual(vector: dict[str, str]) -> None:
    family = "ssw07" if vector["id"].startswith("S7") else "ssw06"
    address, pdu = decode(bytes.fromhex(vector["request"]))
    unit = make_unit(family, address, model="85.0A", firmware=FIRMWARE[family])
    unit.fixed.update({2: 500, 3: 400})  # type: ignore[attr-defined]  # the manuals' 50.0 %, 40.0 A

    assert encode(address, Talk(unit).unit.handle(pdu, 0.0) or b"silence") == bytes.fromhex(vector["reply"])
