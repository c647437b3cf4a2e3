from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

import gateway.families
from gateway.errors import ProfileError, UsageError
from gateway.families.profile.load import load_profile, read_profile

PROFILES = Path(gateway.families.__file__).parent / "profiles"


@pytest.fixture
def ssw06(tmp_path: Path) -> Path:
    return Path(shutil.copytree(PROFILES / "ssw06", tmp_path / "ssw06"))


@pytest.fixture
def sst(tmp_path: Path) -> Path:
    return Path(shutil.copytree(PROFILES / "sst", tmp_path / "sst"))


def edit(path: Path, change: Callable[[str], str]) -> None:
    before = path.read_text(encoding="utf-8")
    after = change(before)
    assert after != before
    path.write_text(after, encoding="utf-8")


def replace(path: Path, pattern: str, by: str) -> None:
    edit(path, lambda text: re.sub(pattern, by, text, count=1, flags=re.MULTILINE))


def append(path: Path, line: str) -> None:
    edit(path, lambda text: f"{text}{line}\n")


def problems_of(directory: Path) -> list[str]:
    with pytest.raises(ProfileError) as caught:
        read_profile(directory)
    return caught.value.problems


@pytest.mark.parametrize("family", ["ssw08", "", "../ssw07"])
def test_a_family_that_is_not_shipped_is_refused_with_the_list(family: str) -> None:
    with pytest.raises(UsageError, match="sst, ssw06, ssw07, ssw900"):
        load_profile(family)


def test_every_mistake_is_reported_at_once_with_its_place(ssw06: Path) -> None:
    replace(ssw06 / "parameters.csv", "^P002,(.*),holding,2,", r"P002,\1,drum,2,")
    replace(ssw06 / "enums.csv", "^P229,4,", "P229,four,")
    append(ssw06 / "bits.csv", "VB01,15,Error again")
    append(ssw06 / "alarms.csv", "e31,disaster,Something")
    replace(ssw06 / "family.toml", "^title = .*", "tittle = 'x'")  # codespell:ignore

    text = "\n".join(problems_of(ssw06))

    assert "parameters.csv:4: table" in text
    assert re.search(r"enums\.csv:\d+: value: must be a whole number", text)
    assert "bits.csv:82: VB01 has 15 twice" in text
    assert "alarms.csv:5: severity" in text
    assert "family.toml: title: is missing" in text
    assert "family.toml: tittle: is no known key" in text  # codespell:ignore


@pytest.mark.parametrize("damage", ["family = [", ""])
def test_an_unreadable_family_file_is_a_problem_among_others(ssw06: Path, damage: str) -> None:
    (ssw06 / "family.toml").write_text(damage, encoding="utf-8")
    lines = len((ssw06 / "enums.csv").read_text("utf-8").splitlines())
    append(ssw06 / "enums.csv", "P230,none,x")

    text = "\n".join(problems_of(ssw06))

    assert "family.toml" in text
    assert f"enums.csv:{lines + 1}" in text


def test_a_code_that_stands_twice_is_a_problem(ssw06: Path) -> None:
    edit(ssw06 / "parameters.csv", lambda text: text + text.splitlines()[-1] + "\n")

    assert problems_of(ssw06) == ["parameters.csv:76: VB03.7 stands twice"]


def test_ranges_of_a_row_that_does_not_exist_are_a_problem(sst: Path) -> None:
    append(sst / "ranges.csv", "R99,SST330i,0,1")
    append(sst / "ranges.csv", "R39,SST330i,zero,1")

    problems = problems_of(sst)

    assert problems[0].startswith("ranges.csv:21: raw_min")
    assert "ranges.csv: R99 is no parameter" in problems


# One contradiction each, by file: pattern, replacement, and the complaint.
START = "word = .VB03., set_bits = 0x01, mask_shift = 8"
CONTRADICTIONS = {
    "parameters.csv": [
        ("^VB10,", "vb10,", "vb10: codes are written in upper case"),
        ("^(VB09,.*),u16,", r"\1,u32,", "VB09: u32 takes 2 words, not 1"),
        ("^(VB09,.*),u16,", r"\1,bit,", "VB09: a coil is a bit, and nothing else is"),
        ("^(P220,.*),rw,P220,", r"\1,rw,P221,", "P220: enum 'P221' does not exist"),
        ("^(P220,.*),rw,P220,", r"\1,rw,,", "P220: enum '' does not exist"),
        ("^(P314,.*),0,999,", r"\1,0,70000,", "P314: limits 0..70000 do not fit u16"),
        ("^(P314,.*),0,999,", r"\1,1000,999,", "P314: limits 1000..999 do not fit u16"),
        ("^(P314,.*),0,999,", r"\1,,999,", "P314: limits None..999 do not fit u16"),
        ("^(P314,.*),u16,", r"\1,string,", "P314: limits 0..999 do not fit string"),
        ("^(P003,.*),holding,3,", r"\1,holding,2,", "P003: overlaps P002"),
        ("^(VB00,.*),u16,", r"\1,bits,", "VB00: its bits are not named"),
    ],
    "enums.csv": [
        (r"\Z", "P999,0,Nothing\n", "enums.csv: no parameter uses P999"),
    ],
    "bits.csv": [
        (r"\Z", "VB11,0,Nothing\n", "bits.csv: VB11 is no row of bits"),
        (r"\Z", "VB01,16,Nothing\n", "bits.csv: VB01 has no bit 16"),
    ],
    "alarms.csv": [
        (r"\Z", "e28,fault,Again\n", "alarms.csv: e28 stands twice"),
    ],
    "family.toml": [
        ('"VB01"$', '"VB11"', "family.toml: VB11 is no parameter"),
        ('^status_word = "VB01"', 'status_word = "VB05"', "family.toml: VB05 is no parameter"),
        ('^P308 = "2.1"', 'P390 = "2.1"', "protected: P390 is no parameter"),
        (r'^ready = \["general_enabled"', 'ready = ["enabled"', "state: enabled is no point"),
        (
            "set_bits = 0x02, mask_shift = 8",
            "set_bits = 0x02",
            "written in VB03 is none of command_bits",
        ),
        ('^current = { code = "P003"', 'current = { code = "P004"', "points.current: P004 is no"),
        ('^current = { code = "P003"', 'current = { code = "P200"', "points.current: P200 is no"),
        ('^current = { code = "P003", ', "current = { ", "points.current: needs either a code"),
        ("^p030 = .*", 'p030 = { none_of = ["p031", "p033"] }', "points.p030: p033 is no point"),
        ("bit = 15", "bit = 16", "family.toml: points.fault.bit"),
        ('"VB06", group', '"P003", bit = 3, group', "points.vb06: P003 has no bit 3"),
        ('point = "fault"', 'point = "error"', "commands.reset: error is no point"),
        ("word = .VB03., set_bits = 0x01", "set_bits = 0x01", "commands.start: a write needs either"),
        ("word = .VB03., set_bits", 'word = "VB08", set_bits', "commands.start: VB08 is not there"),
        ("word = .VB03., set_bits", 'word = "VB11", set_bits', "commands.start: VB11 is not there"),
        (START, "coil = 1", "start: coil 1 is not there"),
        (START, "coil = 99", "coil 99 is not there"),
        ("set_bits = 0x01, mask_shift = 8", "set_bits = 0x01, mask_shift = 16", "do not fit one word"),
        ("set_bits = 0x01, ", "set_bits = 0x01, clear_bits = 1, ", "do not fit one word"),
        (r"^\[commands.jog_off\]", "[commands.jog_down]", "commands.jog: commands.jog_off is missing"),
        ("^restarts = true", 'flags = ["whole"]', "commands.reset: commands.reset_whole is missing"),
        ("needs = { P220", "needs = { P22", "commands.local_remote: P22 is no parameter"),
        ("^bauds", 'alarm_rows = { P014 = "e" }\nbauds', "family.toml: P014 is no parameter"),
        ('^function = "P277"', 'function = "P99"', "outputs.RL1: P99 is no parameter"),
        ('^word = "VB09"', 'word = "VB19"', "outputs.AO1: VB19 is no parameter"),
        ("^full_scale = 16383", "", "outputs.AO1: needs either a bit or full_scale"),
        (r"functions = \[1, 3", "functions = [3", "the coil table cannot be read without 1"),
        ("frame_bytes = 256", "frame_bytes = 254", "read_registers: 125 do not fit a frame"),
        ("frame_bytes = 256", "frame_bytes = 254", "write_registers: 123 do not fit a frame"),
    ],
}


@pytest.mark.parametrize(
    ("file", "pattern", "by", "complaint"),
    [(file, *row) for file, table in CONTRADICTIONS.items() for row in table],
)
def test_parts_that_contradict_each_other_are_reported(
    ssw06: Path, file: str, pattern: str, by: str, complaint: str
) -> None:
    replace(ssw06 / file, pattern, by)

    assert any(complaint in problem for problem in problems_of(ssw06))


@pytest.mark.parametrize("alias", ["S5.1.2", "S5.2.5"])
def test_an_alias_must_be_on_the_same_register(tmp_path: Path, alias: str) -> None:
    directory = Path(shutil.copytree(PROFILES / "ssw900", tmp_path / "ssw900"))
    replace(directory / "parameters.csv", "^(S3.1.3.1,.*),S5.1.1,", rf"\1,{alias},")

    assert f"S3.1.3.1: {alias} is not on the same register" in problems_of(directory)
