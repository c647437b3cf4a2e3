"""The audit's segment files: where they are, which came first, and what stands at their ends."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from gateway.storage.audit.chain import Head, read_line
from gateway.system.whole_files import write_whole

FOLDER = "audit"  # in the state directory
LOCK = "lock"  # in that folder
ANCHOR = "anchor.json"  # where the chain stood at the end of the last segment that was removed

_SEGMENT = re.compile(r"audit-(\d{8})\.jsonl", re.ASCII)


class Anchor(NamedTuple):
    """The last removed segment, and where the chain stood after it; None when that was not known."""

    segment: int = 0
    head: Head | None = Head()


class Tail(NamedTuple):
    """The end of a segment: after how many octets its last whole line ends, and what follows that."""

    size: int
    torn: int  # octets of a line that a crash cut short
    head: Head | None  # None: no line, or one that makes no sense
    is_empty: bool


def segment_path(folder: Path, number: int) -> Path:
    """Return where a segment is."""
    return folder / f"audit-{number:08d}.jsonl"


def segments(folder: Path) -> list[int]:
    """Return the numbers of the segments that are there and not yet given up, the oldest first."""
    matches = (_SEGMENT.fullmatch(name) for name in os.listdir(folder))
    first = read_anchor(folder).segment
    return sorted(number for match in matches if match and (number := int(match[1])) > first)


def read_anchor(folder: Path) -> Anchor:
    """Return the anchor; a damaged one anchors nothing."""
    try:
        fields = json.loads((folder / ANCHOR).read_text("utf-8"))
        number, hash_ = fields["n"], fields["hash"]
        return Anchor(int(fields["segment"]), None if hash_ is None else Head(int(number), str(hash_)))
    except FileNotFoundError:
        return Anchor()
    except (ValueError, KeyError, TypeError):
        return Anchor(0, None)


def write_anchor(folder: Path, anchor: Anchor) -> None:
    """Replace the anchor in one step; OSError."""
    head = anchor.head
    fields = {"segment": anchor.segment, "n": head and head.number, "hash": head and head.hash}
    write_whole(folder / ANCHOR, json.dumps(fields).encode())


def tail(path: Path) -> Tail:
    """Return what stands at the end of a segment."""
    octets = path.read_bytes()
    size = octets.rfind(b"\n") + 1
    torn = len(octets) - size
    if not size:
        return Tail(0, torn, None, is_empty=True)
    begin = octets.rfind(b"\n", 0, size - 1) + 1
    try:
        _, head = read_line(octets[begin : size - 1].decode("utf-8"))
    except ValueError:
        return Tail(size, torn, None, is_empty=False)
    return Tail(size, torn, head, is_empty=False)


def lines(folder: Path) -> Iterator[tuple[str, str]]:
    """Return all whole lines in order, each with its place; octets that are no UTF-8 are replaced."""
    for number in segments(folder):
        path = segment_path(folder, number)
        try:
            octets = path.read_bytes()
        except FileNotFoundError:  # removed by the gateway meanwhile, as the anchor records
            continue
        whole = octets[: octets.rfind(b"\n") + 1]
        for place, line in enumerate(whole.split(b"\n")[:-1], 1):
            yield f"{path.name}:{place}", line.decode("utf-8", "replace")
