"""`starter-gateway history`: lists the starts and trips of a starter, and exports one as CSV or COMTRADE.

Reads the gateway's file beside a gateway that runs or not; changes nothing in it.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from gateway.cli.command import flag, place_of, write_text
from gateway.config.load import load
from gateway.config.schema import StarterTable
from gateway.errors import StoreError, UsageError
from gateway.families import load_profile
from gateway.plugins.history.export import Recording, recording_of, to_comtrade, to_csv
from gateway.store import HistoryRow, read_history

TRIP, START, CURVE = "trip", "start", "curve"  # kinds of rows
STDOUT = "-"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's description and arguments."""
    parser.description = (
        "List the starts and trips that a gateway has recorded of a starter, or export one of "
        "them: the newest trip, or the one of --id."
    )
    parser.add_argument("config", metavar="CONFIG", help="the gateway's configuration")
    parser.add_argument("starter", metavar="STARTER", help="name of the starter")
    parser.add_argument("--id", metavar="ID", help="of a start or a trip, as it is listed")
    parser.add_argument("--csv", metavar="FILE", help="write its readings as CSV; - prints them")
    parser.add_argument(
        "--comtrade", metavar="BASENAME", help="write BASENAME.cfg and BASENAME.dat (IEC 60255-24, ASCII)"
    )
    flag(parser, "--json", about="print the records as they are stored, one a line")


def run(args: argparse.Namespace) -> int:
    """Print or write, and return 0."""
    path = Path(args.config)
    config = load(path)
    _, starter = place_of(config, args.starter)
    records = _records(read_history(path.parent / config.gateway.state_dir, starter.name))
    if args.id is not None:
        records = [each for each in records if each.get("id") == args.id]
        if not records:
            raise UsageError(f"{starter.name} has no record {args.id}; without --id they are listed")
    if args.csv is None and args.comtrade is None:
        _print(records, as_json=args.json)
        return 0
    recording = _recording(starter, records)
    if args.csv == STDOUT:
        sys.stdout.write(to_csv(recording))
    elif args.csv is not None:
        _write(Path(args.csv), to_csv(recording), recording)
    if args.comtrade is not None:
        for ending, text in zip((".cfg", ".dat"), to_comtrade(recording), strict=True):
            _write(Path(args.comtrade + ending), text, recording)
    return 0


def _records(rows: Iterable[HistoryRow]) -> list[dict[str, Any]]:
    """Return the starts and trips as they came; a start has its curve while that is stored."""
    rows = list(rows)
    curves = {row.id: row.data for row in rows if row.kind == CURVE}
    found = []
    for row in rows:
        if row.kind == TRIP:
            found.append(dict(row.data))
        elif row.kind == START:
            found.append({**row.data, **({"samples": curves[row.id]} if row.id in curves else {})})
    return found


def _recording(starter: StarterTable, records: Sequence[Mapping[str, Any]]) -> Recording:
    """Return the readings of the newest trip, else of the newest start."""
    chosen = [each for each in records if "readings" in each] or list(records)
    if not chosen:
        raise StoreError(f"{starter.name} has no record of a start or a trip yet")
    profile = load_profile(starter.family)
    units = {
        name: profile.parameters[point.code].unit for name, point in profile.points.items() if point.code
    }
    try:
        return recording_of(starter.name, chosen[-1], units=units)
    except ValueError as error:
        raise StoreError(f"{starter.name}, {chosen[-1].get('id')}: {error}") from error


def _print(records: Sequence[Mapping[str, Any]], *, as_json: bool) -> None:
    for record in records:
        if as_json:
            print(json.dumps(record, ensure_ascii=False))
        else:
            kind = TRIP if "readings" in record else START
            print(f"{record.get('time')}  {record.get('id'):24}  {kind:5}  {_about(record)}")
    if not records and not as_json:
        print("no starts and no trips are recorded yet")


def _about(record: Mapping[str, Any]) -> str:
    if "readings" in record:
        before = record.get("state_before")
        return f"{record.get('code')} {record.get('text')}" + (f", was {before}" if before else "")
    known = {"acceleration_s": "s", "peak_a": "A", "i2t_a2s": "A²s"}
    parts = [f"{record[key]:g} {unit}" for key, unit in known.items() if key in record]
    curve = [] if "samples" in record else ["summary only"]
    return ", ".join([str(record.get("outcome")).replace("_", " "), *parts, *curve])


def _write(path: Path, text: str, recording: Recording) -> None:
    write_text(path, text)
    print(f"{path}: {recording.kind} {recording.id} of {recording.starter}, {len(recording.t_s)} moments")
