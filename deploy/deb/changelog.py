"""The package's changelog, in Debian's form, from CHANGELOG.md."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator
from datetime import UTC, datetime
from email.utils import format_datetime
from pathlib import Path

from deploy.deb.targets import Distribution, package_version

MAINTAINER = "Starter Gateway maintainers <maintainers@starter-gateway.invalid>"
_VERSION = re.compile(r"^## \[([\d.]+)\] - (\d{4}-\d\d-\d\d)$", re.MULTILINE)
_ITEM = re.compile(r"^- (.*(?:\n  .*)*)", re.MULTILINE)


def debian_changelog(top: Path, distribution: Distribution) -> str:
    """Return an entry for each release, the newest first."""
    return "\n".join(
        _entry(package_version(version, distribution), day, text, distribution.suite)
        for version, day, text in _releases((top / "CHANGELOG.md").read_text("utf-8"))
    )


def _releases(text: str) -> Iterator[tuple[str, str, str]]:
    """Yield version, day and text of each release."""
    _, *parts = _VERSION.split(text)
    yield from zip(parts[::3], parts[1::3], parts[2::3], strict=True)


def _entry(version: str, day: str, text: str, suite: str) -> str:
    items = [" ".join(item.split()) for item in _ITEM.findall(text)]
    lines = [
        textwrap.fill(item, 78, initial_indent="  * ", subsequent_indent="    ", break_long_words=False)
        for item in items
    ]
    date = format_datetime(_noon(day))
    body = "\n".join(lines)
    return f"starter-gateway ({version}) {suite}; urgency=medium\n\n{body}\n\n -- {MAINTAINER}  {date}\n"


def _noon(day: str) -> datetime:
    return datetime.fromisoformat(day).replace(hour=12, tzinfo=UTC)
