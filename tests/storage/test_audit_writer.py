from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from gateway.storage.audit.chain import Verification, read_line, verify
from gateway.storage.audit.segments import (
    ANCHOR,
    lines,
    read_anchor,
    segment_path,
    segments,
)
from gateway.storage.audit.writer import AuditWriter


def note(code: str, text: str) -> dict[str, Any]:
    return {"kind": "note", "code": code, "text": text}


@contextmanager
def writer(folder: Path, *, segment_bytes: int = 10_000, most_segments: int = 4) -> Iterator[AuditWriter]:
    writer = AuditWriter(folder, segment_bytes, most_segments)
    yield writer
    writer.close()


def write(folder: Path, count: int, **options: int) -> None:
    with writer(folder, **options) as one:
        for number in range(count):
            one.append([{"what": f"entry {number}"}], note=note)


def check(folder: Path) -> Verification:
    return verify(lines(folder), after=read_anchor(folder).head)


def said(folder: Path) -> list[str]:
    entries = [read_line(line)[0] for _, line in lines(folder)]
    return [str(entry.get("code") or entry["what"]) for entry in entries]


def test_segments_are_bounded_in_size_and_number_and_the_chain_stays_whole(tmp_path: Path) -> None:
    write(tmp_path, 100, segment_bytes=1000, most_segments=3)

    numbers = segments(tmp_path)
    sizes = [segment_path(tmp_path, number).stat().st_size for number in numbers]
    assert len(numbers) == 3
    assert max(sizes) < 1500
    assert check(tmp_path).problems == ()
    assert check(tmp_path).count < 100
    assert read_anchor(tmp_path).segment == numbers[0] - 1


def test_the_end_of_a_line_that_a_crash_cut_short_is_removed_and_reported(tmp_path: Path) -> None:
    write(tmp_path, 2)
    with segment_path(tmp_path, 1).open("ab") as file:
        file.write(b'{"half of a li')

    write(tmp_path, 1)

    assert said(tmp_path) == ["entry 0", "entry 1", "line_torn", "entry 0"]
    assert check(tmp_path).problems == ()


@pytest.mark.parametrize("octets", [b"nonsense\n", b'\xff{"n":3}\n'])
def test_an_end_that_makes_no_sense_is_left_as_evidence_and_a_new_chain_begun(
    tmp_path: Path, octets: bytes
) -> None:
    write(tmp_path, 2)
    with segment_path(tmp_path, 1).open("ab") as file:
        file.write(octets)

    write(tmp_path, 1)

    assert segments(tmp_path) == [1, 2]
    assert segment_path(tmp_path, 1).read_bytes().endswith(octets)
    assert len(check(tmp_path).problems) == 2
    last = [read_line(line)[0] for _, line in list(lines(tmp_path))[-2:]]
    assert [entry.get("code") for entry in last] == ["chain_begun_anew", None]


def test_after_a_failed_write_the_entries_are_written_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(fd: int) -> None:
        raise OSError(28, "No space left on device")

    with writer(tmp_path) as one:
        one.append([{"what": "a"}], note=note)
        with monkeypatch.context() as patch:
            patch.setattr(os, "fsync", fail)
            with pytest.raises(OSError, match="No space"):
                one.append([{"what": "b"}], note=note)
        one.close()
        one.append([{"what": "b"}], note=note)

    assert said(tmp_path) == ["a", "b"]
    assert check(tmp_path).problems == ()


def test_a_damaged_anchor_without_segments_is_reported_when_the_chain_begins(tmp_path: Path) -> None:
    (tmp_path / ANCHOR).write_text("nonsense")

    write(tmp_path, 1)

    assert said(tmp_path) == ["chain_begun_anew", "entry 0"]


def test_a_segment_of_which_only_half_a_line_was_written_is_gone_on_with(tmp_path: Path) -> None:
    tmp_path.joinpath("audit-00000001.jsonl").write_bytes(b'{"half of a li')

    write(tmp_path, 1)

    assert said(tmp_path) == ["line_torn", "entry 0"]
    assert check(tmp_path).problems == ()


def test_a_folder_emptied_while_the_disk_was_away_is_reported(tmp_path: Path) -> None:
    with writer(tmp_path) as one:
        one.append([{"what": "a"}], note=note)
        one.close()
        segment_path(tmp_path, 1).unlink()
        one.append([{"what": "b"}], note=note)

    assert said(tmp_path) == ["chain_begun_anew", "b"]
