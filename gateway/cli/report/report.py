"""`starter-gateway report`: the health report of one starter, printed or as a page.

Reads the state directory beside a gateway that runs or not, and asks the broker for what the gateway has
published last; changes nothing in either.
"""

from __future__ import annotations

import argparse
import asyncio
import time
from pathlib import Path
from typing import TypeVar

from gateway.cli.broker import add_login, settings_of
from gateway.cli.command import add_starter, flag, place_of, write_text
from gateway.cli.report.document import document_of
from gateway.cli.report.facts import PublishedFacts, facts_of
from gateway.cli.report.html import to_html
from gateway.cli.report.text import to_text
from gateway.config import load
from gateway.contract import InfoRecord, LineRecord, Record, Topics, ValueRecord, stored
from gateway.errors import GatewayError
from gateway.families import LANGUAGES
from gateway.mqtt import BrokerSettings, CommandClient

WITHIN_S = 1.0  # a retained record comes at once
COUNTERS = ("hours_total", "energy_kwh")  # of the starter, where it has them

R = TypeVar("R", bound=Record)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's description and arguments."""
    parser.description = (
        "Print the health of a motor and its starter: identity, hours, starts against the baseline, trends, "
        "trips, changed parameters, the line. With --html a page that prints well on A4."
    )
    add_starter(parser)
    parser.add_argument("--html", metavar="FILE", help="write a page with plots instead of printing")
    parser.add_argument("--language", choices=LANGUAGES, help="of the report (default: the configuration's)")
    flag(parser, "--no-broker", about="leave out the parts that only the broker knows")
    add_login(parser)


def run(args: argparse.Namespace) -> int:
    """Print or write the report, and return 0."""
    folder, config = Path(args.config).parent, load(args.config)
    line, starter = place_of(config, args.starter)
    language = args.language or config.gateway.language
    state_dir, profile = folder / config.gateway.state_dir, starter.profile(language)
    published, why = PublishedFacts({}, {}, {}), "the broker was not asked"
    if not args.no_broker:
        try:
            settings = settings_of(config, folder, tool="report", login=args)
            topics = Topics(config.base)
            published = asyncio.run(_published(settings, topics, line=line.name, starter=starter.name))
            why = ""
        except GatewayError as error:
            why = str(error).partition("\n")[0]
    facts = facts_of(line, starter, profile=profile, state_dir=state_dir, published=published)
    if why:
        facts.notes.append(f"the line's quality and the starter's own counters are left out: {why}")
    document = document_of(facts, gateway=config.gateway.name, made_s=time.time(), language=language)
    if args.html is None:
        print(to_text(document), end="")
    else:
        page = to_html(document, language=language)
        write_text(Path(args.html), page)
        print(f"{args.html}: written, {len(page.encode()) / 1024:.0f} KB; print it on A4 from a browser")
    return 0


async def _published(settings: BrokerSettings, topics: Topics, *, line: str, starter: str) -> PublishedFacts:
    """Return what the gateway has published last; BrokerError."""

    async def asked(kind: type[R], **names: str) -> R | None:
        return await CommandClient(settings, topics).retained(kind, within_s=WITHIN_S, **names)

    statistics, info = await asked(LineRecord, line=line), await asked(InfoRecord, starter=starter)
    counters = [await asked(ValueRecord, starter=starter, point=point) for point in COUNTERS]
    values = {c.point: c.value for c in counters if c is not None and isinstance(c.value, int | float)}
    return PublishedFacts(
        {} if statistics is None else statistics.data, {} if info is None else stored(info), values
    )
