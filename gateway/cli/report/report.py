"""`starter-gateway report`: the health report of one starter, printed or as a page.

Reads the state directory beside a gateway that runs or not, and asks the broker for what the gateway has
published last; changes nothing in either.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from gateway.cli.command import flag, place_of, write_text
from gateway.cli.operator_login import add_login, settings_of
from gateway.cli.report.content import (
    HealthReport,
    add_rows,
    add_values,
    line_quality,
    settings_in,
    settings_seen,
)
from gateway.cli.report.html import to_html
from gateway.cli.report.labels import translator
from gateway.cli.report.text import to_text
from gateway.config.load import load
from gateway.config.schema import Config, LineTable, StarterTable
from gateway.contract import InfoRecord, LineRecord, Topics, ValueRecord, read_object, rfc3339
from gateway.errors import GatewayError, StoreError
from gateway.families import LANGUAGES, load_profile
from gateway.mqtt import Incoming, connected
from gateway.starters.identity import FINGERPRINTS, KNOWN
from gateway.store import STATE_FILE, Head, read_audit, read_document, read_history

ASKED_WITHIN_S = 2.0  # retained messages come at once
CONNECTED_WITHIN_S = 5.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's description and arguments."""
    parser.description = (
        "Print how a motor and its starter do: identity, hours, starts against the baseline, "
        "trends, trips, changed parameters, the line. With --html a page that prints well on A4."
    )
    parser.add_argument("config", metavar="CONFIG", help="the gateway's configuration")
    parser.add_argument("starter", metavar="STARTER", help="name of the starter")
    parser.add_argument("--html", metavar="FILE", help="write a page with plots instead of printing")
    parser.add_argument("--language", choices=LANGUAGES, help="of the report (default: the configuration's)")
    flag(parser, "--no-broker", about="leave out what only the broker knows")
    add_login(parser)


def run(args: argparse.Namespace) -> int:
    """Print or write the report, and return 0."""
    path = Path(args.config)
    config = load(path)
    line, starter = place_of(config, args.starter)
    notes: list[str] = []
    published: Mapping[str, dict[str, Any]] = {}
    if args.no_broker:
        notes.append("limits and the line's quality are left out: the broker was not asked")
    else:
        published = _ask_broker(config, starter.name, args, notes)
        if not notes and not published.get(Topics(config.base).of(LineRecord, line=line.name)):
            notes.append("the line's quality is left out: the gateway has not published it")
    language = args.language or config.gateway.language
    report = make_report(path, args.starter, published, language)
    t = translator(language)
    report.notes += notes
    if args.html is None:
        print(to_text(report, t), end="")
    else:
        path, page = Path(args.html), to_html(report, t, language=language)
        write_text(path, page)
        print(f"{path}: written, {len(page.encode()) / 1024:.0f} KB; print it on A4 from a browser")
    return 0


def make_report(
    path: Path, name: str, published: Mapping[str, dict[str, Any]], language: str
) -> HealthReport:
    """Return the report of a configured starter; `published` is by topic what the broker has.

    Raises UsageError for a starter that there is not, StoreError where the history cannot be read.
    """
    config = load(path)
    line, starter = place_of(config, name)
    report = HealthReport(name, config.gateway.name, rfc3339(time.time()) or "")
    state_dir = path.parent / config.gateway.state_dir
    rows, profile = read_history(state_dir, name), load_profile(starter.family, language)
    add_rows(report, rows)
    settings = [*settings_in(_audit(state_dir, report), name, profile), *settings_seen(rows, profile)]
    report.settings = sorted(settings, key=lambda each: each.time, reverse=True)
    topics = Topics(config.base)
    statistics = published.get(topics.of(LineRecord, line=line.name))
    if statistics:
        report.line = line_quality(line.name, name, starter.address, statistics)
    prefix = topics.of(ValueRecord, starter=name, point="x")[:-1]
    add_values(report, {at.removeprefix(prefix): each for at, each in published.items() if prefix in at})
    said = {
        key: value
        for key, value in published.get(topics.of(InfoRecord, starter=name), {}).items()
        if value is not None
    }
    known = {**_known_identity(state_dir, name), **said}
    report.identity = _identity(report, line, starter, known, language)
    return report


def _audit(state_dir: Path, report: HealthReport) -> Sequence[Mapping[str, Any]]:
    """Return the entries of the audit, the oldest first; a line that is none is left out."""
    if not (state_dir / STATE_FILE).exists():
        return []

    def entries(_: Head | None, lines: Iterator[tuple[str, str]]) -> list[Mapping[str, Any]]:
        found: list[Mapping[str, Any]] = []
        for _place, text in lines:
            with suppress(ValueError):
                entry = json.loads(text)
                if isinstance(entry, dict):
                    found.append(entry)
        return found

    try:
        return read_audit(state_dir / STATE_FILE, entries)
    except StoreError as error:
        report.notes.append(f"the audit cannot be read ({error}): changed parameters are left out")
        return []


def _known_identity(state_dir: Path, name: str) -> Mapping[str, Any]:
    """Return the fingerprint that the gateway has stored; empty without one."""
    try:
        known = (read_document(state_dir / STATE_FILE, FINGERPRINTS, KNOWN) or {}).get(name)
    except StoreError:
        return {}
    return {} if known is None else known.fingerprint.as_data()


def _identity(
    report: HealthReport, line: LineTable, starter: StarterTable, known: Mapping[str, Any], language: str
) -> dict[str, str]:
    """Return what the starter is, by label; `known` is what it has said itself."""
    t = translator(language)
    rated_a = known.get("rated_current_a") or report.rated_a
    fields = {
        "starter": starter.name,
        "family": starter.family.upper(),
        "model": starter.model or known.get("model"),
        "firmware": known.get("firmware"),
        "serial number": known.get("serial"),
        "rated current": f"{rated_a:g} A" if isinstance(rated_a, int | float) else None,
        "line": f"{line.name} ({line.port}, {line.baud} {line.framing})",
        "address": str(starter.address),
    }
    return {t(label): str(value) for label, value in fields.items() if value}


def _ask_broker(
    config: Config, starter: str, args: argparse.Namespace, notes: list[str]
) -> dict[str, dict[str, Any]]:
    """Return by topic what the gateway has published last; a note when that cannot be had."""
    try:
        return asyncio.run(_published(config, Topics(config.base), starter, args))
    except (GatewayError, TimeoutError) as error:
        why = str(error).splitlines()[0] if str(error) else f"no answer within {CONNECTED_WITHIN_S:g} s"
        notes.append(f"limits and the line's quality are left out: {why}")
        return {}


async def _published(
    config: Config, topics: Topics, starter: str, args: argparse.Namespace
) -> dict[str, dict[str, Any]]:
    settings = settings_of(config, Path(args.config).parent, tool="report", login=args)
    found: dict[str, dict[str, Any]] = {}

    def take(message: Incoming) -> None:
        with suppress(ValueError):
            found[message.topic] = read_object(message.payload)

    async with asyncio.timeout(CONNECTED_WITHIN_S):
        session, _ = await connected(settings, on_incoming=take)
        values = f"{topics.starter(starter)}/value/+"
        for topic in (f"{config.base}/gateway/line/+", topics.of(InfoRecord, starter=starter), values):
            await session.subscribe(topic, with_retained=True)
    await asyncio.wait([session.lost], timeout=ASKED_WITHIN_S)
    await session.disconnect()
    return found
