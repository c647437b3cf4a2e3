from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.families.profile.load import FAMILIES, load_profile
from gateway.families.profile.rows import Table
from gateway.families.profile.schema import Point, Profile, Variant
from gateway.families.reading import GROUPS, LEAST_DELAY_S, Block, plan_blocks, split
from gateway.modbus.reads import ReadCoils, ReadHoldingRegisters, ReadInputRegisters
from gateway.modbus.timing import Framing, LineTiming

UNKNOWN = Variant()


def requests(family: str) -> dict[str, object]:
    return {block.name: block.request for block in plan_blocks(load_profile(family), UNKNOWN)}


def count(block: Block) -> int:
    request: Any = block.request
    assert request.address == block.address
    return int(request.count)


def addresses(block: Block) -> range:
    return range(block.address, block.address + count(block))


def polling(family: str, codes: set[str]) -> Profile:
    """Return a profile that polls exactly these rows."""
    points = {f"x{place}": Point(code=code) for place, code in enumerate(sorted(codes))}
    return load_profile(family).model_copy(update={"points": points})


READABLE = {
    family: sorted(row.code for row in load_profile(family).parameters.values() if row.access != "none")
    for family in FAMILIES
}


@st.composite
def plans(draw: st.DrawFn) -> tuple[Profile, tuple[Block, ...]]:
    family = draw(st.sampled_from(FAMILIES))
    codes = draw(st.sets(st.sampled_from(READABLE[family]), max_size=60))
    profile = polling(family, codes)
    return profile, plan_blocks(profile, UNKNOWN)


def test_the_ssw900_is_polled_in_few_long_reads() -> None:
    assert requests("ssw900") == {
        "status:D1.1.1": ReadHoldingRegisters(90, 6),
        "status:S5.1.1": ReadHoldingRegisters(680, 7),
        "values:S1.1.5": ReadHoldingRegisters(2, 24),
        "slow:S4.2.1": ReadHoldingRegisters(50, 11),
        "slow:S3.1.2": ReadHoldingRegisters(232, 1),
    }


def test_the_ssw07_is_polled_without_a_hole() -> None:
    assert requests("ssw07") == {
        "status:VB01": ReadHoldingRegisters(5001, 1),
        "values:P002": ReadHoldingRegisters(2, 2),
        "values:P014": ReadHoldingRegisters(14, 1),
        "slow:P005": ReadHoldingRegisters(5, 3),
        "slow:P011": ReadHoldingRegisters(11, 1),
        "slow:P030": ReadHoldingRegisters(30, 3),
        "slow:P050": ReadHoldingRegisters(50, 1),
        "slow:P081": ReadHoldingRegisters(81, 1),
    }


def test_the_ssw06_is_polled_without_a_hole() -> None:
    assert requests("ssw06") == {
        "status:VB01": ReadHoldingRegisters(5001, 1),
        "values:P002": ReadHoldingRegisters(2, 2),
        "values:VB06": ReadHoldingRegisters(5006, 1),
        "slow:P010": ReadHoldingRegisters(10, 2),
        "slow:P030": ReadHoldingRegisters(30, 3),
        "slow:P006": ReadHoldingRegisters(6, 1),
    }


def test_the_sst_is_polled_in_one_read_of_coils_and_one_of_registers() -> None:
    assert requests("sst") == {
        "status:COIL1": ReadCoils(0, 26),
        "status:R12": ReadInputRegisters(12, 9),
        "slow:R41": ReadInputRegisters(41, 2),
    }


@pytest.mark.parametrize("family", FAMILIES)
def test_every_point_is_read_in_its_own_group_or_an_earlier_one(family: str) -> None:
    profile = load_profile(family)
    group_of = {code: block.group for block in plan_blocks(profile, UNKNOWN) for code in block.codes}

    for point in profile.points.values():
        if point.code:
            assert GROUPS.index(group_of[point.code]) <= GROUPS.index(point.group)


@pytest.mark.parametrize("family", FAMILIES)
def test_the_names_of_blocks_are_unique(family: str) -> None:
    names = [block.name for block in plan_blocks(load_profile(family), UNKNOWN)]

    assert len(names) == len(set(names))


def test_a_row_that_points_of_two_groups_need_is_read_once() -> None:
    profile = load_profile("ssw07")
    points = {
        "running": Point(code="VB01", bit=0, group="status"),
        "status_word": Point(code="VB01", group="slow"),
    }

    blocks = plan_blocks(profile.model_copy(update={"points": points}), UNKNOWN)

    assert [block.name for block in blocks] == ["status:VB01"]


def test_a_row_that_only_newer_firmware_has_is_not_polled_on_an_old_starter() -> None:
    late = {"late": Point(code="P314", since_firmware="1.40")}
    profile = load_profile("ssw07").model_copy(update={"points": late})

    assert plan_blocks(profile, Variant(firmware="V1.30")) == ()
    assert len(plan_blocks(profile, Variant(firmware="V1.40"))) == 1


def test_a_row_from_elsewhere_does_not_endanger_the_read_of_one_that_the_manual_names() -> None:
    blocks = plan_blocks(polling("ssw07", {"P001", "P002", "P003"}), UNKNOWN)

    assert {block.codes for block in blocks} == {("P001",), ("P002", "P003")}


@given(plans())
def test_a_read_never_asks_for_more_than_the_family_takes(plan: tuple[Profile, tuple[Block, ...]]) -> None:
    profile, blocks = plan

    for block in blocks:
        limits = profile.limits
        longest = limits.read_bits if block.table is Table.COIL else limits.read_registers
        assert count(block) <= longest


@given(plans())
def test_a_read_never_cuts_a_long_value(plan: tuple[Profile, tuple[Block, ...]]) -> None:
    profile, blocks = plan

    for block in blocks:
        covered = set(addresses(block))
        for row in profile.parameters.values():
            own = set(range(row.address, row.address + row.words))
            if row.table is block.table:
                assert own <= covered or not own & covered


@given(plans())
def test_a_read_never_touches_an_unknown_register_where_that_could_refuse_it(
    plan: tuple[Profile, tuple[Block, ...]],
) -> None:
    profile, blocks = plan

    for block in blocks:
        wanted = {row.address + place for row in block.rows for place in range(row.words)}
        holes = set(addresses(block)) - wanted
        assert not holes or profile.limits.max_gap
        if profile.family == "ssw900" and holes:
            assert count(block) >= 3  # shorter reads must be all valid (7.3)


@given(plans())
def test_a_plan_reads_every_row_that_is_wanted_exactly_once(plan: tuple[Profile, tuple[Block, ...]]) -> None:
    profile, blocks = plan

    codes = [code for block in blocks for code in block.codes]
    assert sorted(codes) == sorted(point.code for point in profile.points.values())


def test_a_long_run_is_broken_where_the_family_takes_no_more() -> None:
    blocks = plan_blocks(polling("sst", {f"R{number}" for number in range(43)}), UNKNOWN)

    assert [block.request for block in blocks] == [ReadInputRegisters(0, 24), ReadInputRegisters(24, 19)]


def test_a_refused_block_is_split_into_its_rows() -> None:
    block = plan_blocks(polling("ssw900", {"S1.1.4", "S1.6.2"}), UNKNOWN)[0]
    assert block.request == ReadHoldingRegisters(17, 9)

    parts = split(block)

    assert [part.request for part in parts] == [ReadHoldingRegisters(17, 1), ReadHoldingRegisters(24, 2)]
    assert {part.group for part in parts} == {block.group}
    assert split(parts[1]) == (parts[1],)


def test_the_words_of_a_reply_go_to_their_rows_and_what_lies_between_is_dropped() -> None:
    profile = polling("ssw900", {"S1.6.2", "S1.1.4"})
    block = plan_blocks(profile, UNKNOWN)[0]

    rows = block.rows_in(profile, (500, 1, 2, 3, 4, 5, 6, 23, 0))

    assert rows == {"S1.6.2": (500,), "S1.1.4": (23, 0)}


def test_an_alias_has_the_words_of_its_register_too() -> None:
    profile = load_profile("ssw900")
    block = next(block for block in plan_blocks(profile, UNKNOWN) if "S5.1.1" in block.codes)

    rows = block.rows_in(profile, (99, 1, 2, 3, 4, 5, 6))

    assert rows == {"S5.1.1": (99,), "S3.1.3.1": (99,), "S5.2.5": (5,), "S5.2.6": (6,)}


def test_coils_become_words_of_one_and_zero() -> None:
    profile = polling("sst", {"COIL5", "COIL7"})
    block = plan_blocks(profile, UNKNOWN)[0]

    assert block.rows_in(profile, (True, True, False)) == {"COIL5": (1,), "COIL7": (0,)}


LINE = LineTiming(19200, Framing.parse("8E1"))


def joined(family: str, codes: set[str], timing: LineTiming = LINE) -> list[Any]:
    return [block.request for block in plan_blocks(polling(family, codes), UNKNOWN, timing=timing)]


def test_registers_that_are_not_wanted_are_read_where_that_takes_less_time_than_another_request() -> None:
    near, far = {"S1.1.5", "S1.6.2"}, {"S1.1.5", "S3.1.2"}  # 2 and 17; 2 and 232
    faster = LineTiming(57600, Framing.parse("8E1"))

    assert joined("ssw900", near, faster) == [ReadHoldingRegisters(2, 16)]
    assert joined("ssw900", near) == [ReadHoldingRegisters(2, 1), ReadHoldingRegisters(17, 1)]
    assert joined("ssw900", far, faster) == [ReadHoldingRegisters(2, 1), ReadHoldingRegisters(232, 1)]


def test_where_an_unknown_register_may_refuse_a_read_none_is_spanned_however_cheap() -> None:
    fast = LineTiming(57600, Framing.parse("8E1"))

    assert joined("ssw07", {"P002", "P005"}, fast) == [ReadHoldingRegisters(2, 1), ReadHoldingRegisters(5, 1)]


def test_a_run_that_is_too_long_is_parted_where_that_costs_least() -> None:
    codes = {f"R{number}" for number in (*range(4), *range(8, 28))}

    assert joined("sst", codes) == [ReadInputRegisters(0, 4), ReadInputRegisters(8, 20)]
    assert len(joined("sst", {f"R{number}" for number in range(43)})) == 2


@given(plans(), st.sampled_from([1200, 9600, 19200, 57600]))
def test_what_is_joined_by_cost_keeps_every_rule_of_the_family(
    plan: tuple[Profile, tuple[Block, ...]], baud: int
) -> None:
    profile, without_cost = plan
    timing = LineTiming(baud, Framing.parse("8E1"))

    blocks = plan_blocks(profile, UNKNOWN, timing=timing)

    assert sorted(code for block in blocks for code in block.codes) == sorted(
        code for block in without_cost for code in block.codes
    )
    assert sum(map(seconds(timing), blocks)) <= sum(map(seconds(timing), without_cost)) + 1e-9
    for block in blocks:
        covered = set(addresses(block))
        wanted = {row.address + place for row in block.rows for place in range(row.words)}
        assert count(block) <= (
            profile.limits.read_bits if block.table is Table.COIL else profile.limits.read_registers
        )
        assert covered == wanted or profile.limits.max_gap
        if profile.family == "ssw900" and covered != wanted:
            assert count(block) >= 3
        for row in profile.parameters.values():
            own = set(range(row.address, row.address + row.words))
            wanted_whole = {one.code for one in block.rows}
            if row.table is block.table and row.code in wanted_whole:
                assert own <= covered


def seconds(timing: LineTiming) -> Callable[[Block], float]:
    """Return what a block takes of a line, as far as it depends on how rows are joined."""

    def cost_s(block: Block) -> float:
        size = (count(block) + 7) // 8 if block.table is Table.COIL else 2 * count(block)
        return timing.wire_s(8 + 5 + size) + timing.silence_s + LEAST_DELAY_S

    return cost_s
