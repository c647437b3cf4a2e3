"""List the starts and trips that a gateway has recorded, or export one of them: the newest trip, else the
newest start, or the one of --id.

Reads the gateway's file beside a gateway that runs or not; changes nothing in it.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from gateway.cli.command import add_starter, coded, flag, place_of, write_text
from gateway.config import Config, load
from gateway.errors import StoreError, UsageError
from gateway.plugins.history.export import Recording, recording_of, to_comtrade, to_csv
from gateway.store import HistoryRow, read_history, with_curves

STDOUT = "-"
UNITS = {"acceleration_s": "s", "peak_a": "A", "i2t_a2s": "A²s"}  # of what is listed of a start


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add_starter(parser, about="name of the starter; without it all are listed", nargs="?")
    parser.add_argument("--id", metavar="ID", help="of a start or a trip, as it is listed")
    parser.add_argument("--csv", metavar="FILE", help="write its readings as CSV; - prints them")
    parser.add_argument(
        "--comtrade", metavar="BASENAME", help="write BASENAME.cfg and BASENAME.dat (IEC 60255-24, ASCII)"
    )
    flag(parser, "--json", about="print the records as they are stored, one a line")


def run(args: argparse.Namespace) -> int:
    """Print or write, and return 0."""
    config, folder = load(args.config), Path(args.config).parent
    chosen = [place_of(config, args.starter)[1]] if args.starter else config.starters
    state_dir = folder / config.gateway.state_dir
    rows = [row for starter in chosen for row in with_curves(read_history(state_dir, starter.name))]
    records = sorted((row for row in rows if row.kind in ("start", "trip")), key=_time)
    if args.id is not None:
        records = [record for record in records if record.id == args.id]
        if not records:
            raise UsageError(f"there is no record {args.id}; without --id they are listed")
    if args.csv is None and args.comtrade is None:
        _print(records, as_json=args.json, has_names=len(chosen) > 1)
        return 0
    recording = _recording(config, records)
    if args.csv == STDOUT:
        sys.stdout.write(to_csv(recording))
    elif args.csv is not None:
        _write(Path(args.csv), to_csv(recording), recording)
    if args.comtrade is not None:
        for ending, text in zip((".cfg", ".dat"), to_comtrade(recording), strict=True):
            _write(Path(args.comtrade + ending), text, recording)
    return 0


def _time(row: HistoryRow) -> str:
    return str(row.data.get("time") or "")


def _recording(config: Config, records: Sequence[HistoryRow]) -> Recording:
    """Return the readings of the newest trip, else of the newest start."""
    if not records:
        raise StoreError("no start and no trip is recorded yet")
    record = max(records, key=lambda record: (record.kind == "trip", _time(record)))
    profile = place_of(config, record.starter)[1].profile()
    units = {
        name: profile.parameters[point.code].unit for name, point in profile.points.items() if point.code
    }
    try:
        return recording_of(record.starter, record.data, units=units)
    except ValueError as error:
        raise StoreError(f"{record.starter}, {record.id}: {error}") from error


def _print(records: Sequence[HistoryRow], *, as_json: bool, has_names: bool) -> None:
    for record in records:
        if as_json:
            print(json.dumps({**record.data, "starter": record.starter}, ensure_ascii=False))
        else:
            name = f"{record.starter:16}  " if has_names else ""
            print(f"{_time(record):24}  {name}{record.id:24}  {record.kind:5}  {_about(record)}")
    if not records and not as_json:
        print("no start and no trip is recorded yet")


def _about(record: HistoryRow) -> str:
    data = record.data
    if record.kind == "trip":
        before = data.get("state_before")
        return coded(str(data.get("code")), str(data.get("text"))) + (f", was {before}" if before else "")
    parts = [f"{data[key]:g} {unit}" for key, unit in UNITS.items() if key in data]
    curve = [] if "samples" in data else ["summary only"]
    return ", ".join([str(data.get("outcome")).replace("_", " "), *parts, *curve])


def _write(path: Path, text: str, recording: Recording) -> None:
    write_text(path, text)
    print(f"{path}: {recording.kind} {recording.id} of {recording.starter}, {len(recording.t_s)} moments")
