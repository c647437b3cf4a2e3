"""Show or verify the audit that a gateway stores in its state directory; exit code 1 when its chain is
broken.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from gateway.cli.command import flag
from gateway.config import load
from gateway.errors import UsageError
from gateway.store import FIRST_HASH, STATE_FILE, Head, read_audit, verify


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("action", choices=("show", "verify"), help="print the entries, or check their chain")
    parser.add_argument("path", metavar="STATE_DIR_OR_CONFIG", help="where the gateway stores it")
    parser.add_argument("--last", metavar="N", type=int, help="show only the newest N entries")
    flag(parser, "--json", about="print the entries as they are stored, one a line")
    parser.add_argument(
        "--contains", metavar="HASH", help="verify also that a hash noted earlier is still in the chain"
    )


def run(args: argparse.Namespace) -> int:
    """Print, and return 0; 1 when a check found something."""
    if args.last is not None and args.last < 1:
        raise UsageError(f"--last {args.last} shows nothing (1 or more)")
    path = _file(Path(args.path))
    if args.action == "verify":
        return _verify(path, args.contains)

    def show(_: Head, lines: Iterator[tuple[str, str]]) -> int:
        for _place, line in lines:
            print(line if args.json else _readable(line))
        return 0

    return read_audit(path, show, last=args.last or -1)


def _file(path: Path) -> Path:
    """Return the file with the audit; UsageError when there is none."""
    if path.is_file() and path.suffix == ".toml":
        path = path.parent / load(path).gateway.state_dir
    file = path / STATE_FILE if path.is_dir() else path
    if os.access(file, os.R_OK) and file.is_file():
        return file
    raise UsageError(
        f"no audit in {path} (give the configuration, or its state_dir, as a user who may read it)"
    )


def _verify(path: Path, wanted: str | None) -> int:
    """Print what is wrong with the chain behind its anchor, and return 0, or 1 where something is."""
    anchor, verdict = read_audit(path, lambda anchor, lines: (anchor, verify(lines, after=anchor)))
    is_found = wanted in (None, anchor.hash) or read_audit(
        path, lambda _, lines: any(f'"hash":"{wanted}"' in line for _, line in lines)
    )
    for problem in verdict.problems:
        print(problem)
    described = "broken" if verdict.problems else "whole"
    print(f"{path}: {verdict.count} entries from line {anchor.number + 1} on, chain {described}")
    if verdict.head.hash != FIRST_HASH:
        print(f"newest: line {verdict.head.number}, hash {verdict.head.hash}")
    if not is_found:
        print(f"no line has the hash {wanted}: newer lines were cut off, or it was noted elsewhere")
    return 1 if verdict.problems or not is_found else 0


def entry_in(line: str) -> dict[str, Any]:
    """Return the entry of a line; an empty one where it holds none."""
    with suppress(ValueError):
        entry = json.loads(line)
        return entry if isinstance(entry, dict) else {}
    return {}


def _readable(line: str) -> str:
    entry = entry_in(line)
    if not entry:
        return f"?  {line[:200]!r}"
    head = f"{entry.get('n')}  {entry.get('time')}"
    if entry.get("kind") != "command":
        return f"{head}  -- {entry.get('code')}: {entry.get('text')}"
    claim = entry.get("claimed_operator")
    who = f"{entry.get('client')} (says: {claim})" if claim else str(entry.get("client"))
    args = f" {_json(entry['args'])}" if entry.get("args") else ""
    why = f", reason given: {entry['claimed_reason']}" if entry.get("claimed_reason") else ""
    what = f"{entry.get('verb')} {entry.get('starter')}{args}"
    end = str(entry.get("decision")) + ("" if entry.get("code") == "ok" else f" ({entry.get('code')})")
    return f"{head}  {who}: {what}, id {entry.get('id')}{why}: {end}{_change(entry)}"


def _change(entry: dict[str, Any]) -> str:
    """Return which values were others afterwards; all of them are in the JSON."""
    before, after = entry.get("before") or {}, entry.get("after") or {}
    changed = {name: [before.get(name), value] for name, value in after.items() if before.get(name) != value}
    described = [f"{name} {_json(old)} -> {_json(new)}" for name, (old, new) in changed.items()]
    return f"; {', '.join(described)}" if described else ""


def _json(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)
