"""What is polled: few long reads that touch nothing that could refuse them, and their words by row."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.families.profile.load import FAMILIES, load_profile
from gateway.families.profile.rows import Table
from gateway.families.profile.schema import Point, Profile
from gateway.families.reading import GROUPS, LEAST_DELAY_S, Block, plan_blocks, split
from gateway.modbus.timing import Framing, LineTiming
from tests.families.notation import rows, shown

UNKNOWN = rows("slot=0")[0]
POLLED = {
    "ssw900": "status:D1.1.1=h90*6 status:S5.1.1=h680*7 values:S1.1.5=h2*24 slow:S4.2.1=h50*11"
    " slow:S3.1.2=h232*1",
    "ssw07": "status:VB01=h5001*1 values:P002=h2*2 values:P014=h14*1 slow:P005=h5*3 slow:P011=h11*1"
    " slow:P030=h30*3 slow:P050=h50*1 slow:P081=h81*1",
    "ssw06": "status:VB01=h5001*1 values:P002=h2*2 values:VB06=h5006*1 slow:P010=h10*2 slow:P030=h30*3"
    " slow:P006=h6*1",
    "sst": "status:COIL1=c0*26 status:R12=i12*9 slow:R41=i41*2",
}
READABLE = {
    family: sorted(row.code for row in load_profile(family).parameters.values() if row.access != "none")
    for family in FAMILIES
}


def line(baud: int) -> LineTiming:
    return LineTiming(baud, Framing.parse("8E1"))


def count(block: Block) -> int:
    request: Any = block.request
    assert request.address == block.address
    return int(request.count)


def polling(family: str, codes: set[str]) -> Profile:
    """Return a profile that polls exactly these rows."""
    points = {f"x{place}": Point(code=code) for place, code in enumerate(sorted(codes))}
    return load_profile(family).model_copy(update={"points": points})


def joined(family: str, codes: str, baud: int | None = None) -> str:
    """Return the reads of these rows."""
    timing = None if baud is None else line(baud)
    blocks = plan_blocks(polling(family, set(codes.split())), UNKNOWN, timing=timing)
    return " ".join(shown(each.request) for each in sorted(blocks, key=lambda each: each.address))


@pytest.mark.parametrize("family", FAMILIES)
def test_a_family_is_polled_in_few_reads_each_point_in_its_group_or_an_earlier_one(family: str) -> None:
    profile = load_profile(family)
    blocks = plan_blocks(profile, UNKNOWN)
    group_of = {code: block.group for block in blocks for code in block.codes}

    assert sorted(f"{b.name}={shown(b.request)}" for b in blocks) == sorted(POLLED[family].split())
    for point in profile.points.values():
        if point.code:
            assert GROUPS.index(group_of[point.code]) <= GROUPS.index(point.group)


@given(st.data())
def test_a_plan_keeps_every_rule_of_the_family_whatever_the_line_costs(
    data: st.DataObject,
) -> None:
    family = data.draw(st.sampled_from(FAMILIES))
    profile = polling(family, data.draw(st.sets(st.sampled_from(READABLE[family]), max_size=60)))
    timing = line(data.draw(st.sampled_from([1200, 9600, 19200, 57600])))
    plain, by_cost = (plan_blocks(profile, UNKNOWN, timing=each) for each in (None, timing))

    for blocks in (plain, by_cost):
        codes = [code for block in blocks for code in block.codes]
        assert sorted(codes) == sorted(point.code for point in profile.points.values())
        for block in blocks:
            covered = set(range(block.address, block.address + count(block)))
            wanted = {row.address + place for row in block.rows for place in range(row.words)}
            is_coil = block.table is Table.COIL
            assert count(block) <= (profile.limits.read_bits if is_coil else profile.limits.read_registers)
            assert covered == wanted or profile.limits.max_gap  # an unknown register could refuse it
            assert covered == wanted or family != "ssw900" or count(block) >= 3  # shorter must be valid (7.3)
            assert wanted <= covered
            for row in profile.parameters.values():
                own = set(range(row.address, row.address + row.words))
                if blocks is plain and row.table is block.table:
                    assert own <= covered or not own & covered  # no long value is cut
    assert sum(cost_s(timing, each) for each in by_cost) <= sum(cost_s(timing, each) for each in plain) + 1e-9


def cost_s(timing: LineTiming, block: Block) -> float:
    """Return what a block takes of a line, as far as it depends on how rows are joined."""
    size = (count(block) + 7) // 8 if block.table is Table.COIL else 2 * count(block)
    return timing.wire_s(8 + 5 + size) + timing.silence_s + LEAST_DELAY_S


@pytest.mark.parametrize(
    ("family", "codes", "baud", "expected"),
    [
        # a row from elsewhere does not endanger the read of one that the manual names
        ("ssw07", "P001 P002 P003", None, "h1*1 h2*2"),
        # a long run is broken where the family takes no more
        ("sst", " ".join(f"R{number}" for number in range(43)), None, "i0*24 i24*19"),
        ("sst", " ".join(f"R{number}" for number in (*range(4), *range(8, 28))), 19200, "i0*4 i8*20"),
        # registers between are read where that takes less time than another request
        ("ssw900", "S1.1.5 S1.6.2", 57600, "h2*16"),
        ("ssw900", "S1.1.5 S1.6.2", 19200, "h2*1 h17*1"),
        ("ssw900", "S1.1.5 S3.1.2", 57600, "h2*1 h232*1"),
        # but not where an unknown register may refuse the read
        ("ssw07", "P002 P005", 57600, "h2*1 h5*1"),
    ],
)
def test_rows_are_joined(family: str, codes: str, baud: int | None, expected: str) -> None:
    assert joined(family, codes, baud) == expected


def test_a_refused_block_is_split_into_its_rows() -> None:
    (block,) = plan_blocks(polling("ssw900", {"S1.1.4", "S1.6.2"}), UNKNOWN)

    parts = split(block)

    assert shown(block.request) == "h17*9"
    assert [shown(part.request) for part in parts] == ["h17*1", "h24*2"]
    assert {part.group for part in parts} == {block.group}
    assert split(parts[1]) == (parts[1],)


@pytest.mark.parametrize(
    ("profile", "code", "words", "expected"),
    [
        # what lies between two rows is dropped
        (
            polling("ssw900", {"S1.6.2", "S1.1.4"}),
            "S1.6.2",
            (500, 1, 2, 3, 4, 5, 6, 23, 0),
            {"S1.6.2": (500,), "S1.1.4": (23, 0)},
        ),
        # an alias has the words of its register too
        (
            load_profile("ssw900"),
            "S5.1.1",
            (99, 1, 2, 3, 4, 5, 6),
            {"S5.1.1": (99,), "S3.1.3.1": (99,), "S5.2.5": (5,), "S5.2.6": (6,)},
        ),
        # coils become words of one and zero
        (polling("sst", {"COIL5", "COIL7"}), "COIL5", (True, True, False), {"COIL5": (1,), "COIL7": (0,)}),
    ],
)
def test_the_words_of_a_reply_go_to_their_rows(
    profile: Profile, code: str, words: tuple[int, ...], expected: dict[str, tuple[int, ...]]
) -> None:
    block = next(block for block in plan_blocks(profile, UNKNOWN) if code in block.codes)

    assert block.rows_in(profile, words) == expected
