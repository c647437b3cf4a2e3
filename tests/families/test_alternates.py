from __future__ import annotations

import random
from collections.abc import Sequence
from typing import Any

import pytest

from gateway.families.alternates import MOST, alternates
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.families.profile.rows import Access, Table
from gateway.families.profile.schema import Profile, Variant
from gateway.families.reading import Block, plan_blocks
from gateway.line.rtu.outstanding import expected_shape
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadCoils, ReadHoldingRegisters


def blocks_of(family: str) -> tuple[Block, ...]:
    return plan_blocks(load_profile(family), Variant())


class Starter:
    """Registers and coils with chance contents; coils 0-15 are the bits of VB01."""

    def __init__(self, seed: int) -> None:
        chance = random.Random(seed)
        self.words = [chance.randrange(0x10000) for _ in range(0x2000)]
        self.bits = [bool(self.words[5001] >> at & 1) for at in range(16)]
        self.bits += [chance.random() < 0.5 for _ in range(200)]

    def read(self, request: Any) -> Sequence[Any]:
        table = self.bits if isinstance(request, ReadCoils) else self.words
        return tuple(table[request.address : request.address + request.count])


@pytest.mark.parametrize("family", FAMILIES)
def test_alternates_say_the_same_in_replies_of_other_shapes(family: str) -> None:
    profile, starter = load_profile(family), Starter(1)

    for block in blocks_of(family):
        found = alternates(profile, block.request)
        shapes = [expected_shape(other) for other, _ in found]
        assert len(found) <= MOST
        assert len({expected_shape(block.request), *shapes}) == len(found) + 1
        for other, cut in found:
            assert cut(starter.read(other)) == starter.read(block.request)


@pytest.mark.parametrize("family", FAMILIES)
def test_the_status_can_be_read_in_another_shape(family: str) -> None:
    profile = load_profile(family)
    status = [block.request for block in blocks_of(family) if block.group == "status"]

    assert all(alternates(profile, request) for request in status if not is_whole_table(profile, request))


def is_whole_table(profile: Profile, request: Request) -> bool:
    """Return whether it reads all coils that there are, as the SST's status does."""
    last = max((row.address for row in profile.parameters.values() if row.table is Table.COIL), default=-1)
    return isinstance(request, ReadCoils) and request.address == 0 and request.count > last


@pytest.mark.parametrize("family", FAMILIES)
def test_nothing_is_read_besides_that_no_manual_names(family: str) -> None:
    profile = load_profile(family)
    gap = profile.limits.max_gap
    named = {
        (row.table, row.address + at)
        for row in profile.parameters.values()
        if row.access in (Access.RO, Access.RW)
        for at in range(row.words)
    }

    for block in plan_blocks(profile, Variant()):
        asked = registers(block.table, block.request)
        for other, _ in alternates(profile, block.request):
            assert other.encode()[0] in profile.limits.functions
            table = Table.COIL if isinstance(other, ReadCoils) else block.table
            unnamed = registers(table, other) - asked - named
            assert not unnamed or gap
            for register in unnamed:
                assert any((register[0], register[1] + at) in named for at in range(-gap, gap + 1))


def test_a_write_and_an_unknown_register_have_no_alternates() -> None:
    profile = load_profile("ssw07")

    assert alternates(profile, ReadHoldingRegisters(999, 1)) == ()


def registers(table: Table, request: Request) -> set[tuple[Table, int]]:
    first, count = request.address, request.count  # type: ignore[attr-defined]  # all are runs
    return {(table, at) for at in range(first, first + count)}
