"""Counts the words that plain technical English does without: `python -m tests.words [--lower | PATH ..]`.

A word counts wherever it stands: in names (snake_case and CamelCase parts), texts, comments and documents.
Each room of the tree has a budget in `words.toml` that only goes down; `--lower` writes the present counts
where they are lower. With rooms or paths, each place is printed.
"""

from __future__ import annotations

import re
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
TABLE = Path(__file__).parent / "words.toml"

INSTEAD = {  # the word, and what a book of the field says
    "tell tells told telling": "publish, notify, report, log, decode, distinguish",
    "hear hears heard hearing": "receive",
    "reckon reckons reckoned reckoning": "compute",
    "mend mends mended mending": "hint, remedy, fix, correct",
    "kept": "stored, retained, preserved; of a promise: met, observed",
    "spoil spoils spoiled spoilt spoiling": "corrupted",
    "floor floors": "layer",
    "turn turns": "slot; convert; of a motor: run, rotate",
    "figures": "statistics, measurements",
    "hasten hastens hastened hastening": "expedite",
    "bite bites biting bitten": "problem; of a watchdog: act",
    "bark barks barking barked dog dogs resting": "watchdog, due for its watchdog",
    "nobody whoever whomever lest vain": "say who does what",
    "afar": "remote, remotely",
    "doorstep": "pending",
    "courier errand errands rota aftermath": "the term of the field",
}
PHRASES = {
    r"for\s+ever|forever": "permanently, without limit",
    r"own\s+accord": "unasked",
    r"tak(?:e|es|en|ing)\s+over|took\s+over": "record, apply, replace",
    r"the\s+one\s+who|the\s+living|dead\s+starters?": "the device; answering, offline starters",
}
ALLOWED = {  # what does not count, and why
    r"[\"`]mend[\"`]": "a key of `check --json`: keys do not change",
    r"\b(?:not_kept|NOT_KEPT)\b": "a result code: codes do not change",
    r"SESSION_TAKEN_OVER|[Ss]ession taken over": "the name of MQTT's reason code 0x8E",
    r"\b[Mm]ath\.floor\b": "the function of mathematics",
    r"\b(?:motor|shaft|which|it)\s+turns\b(?!\s+(?:to|into|out))": "a motor turns",
    r"(?:nor|motor)_turns_|_turns_the_other_way|while_the_motor_turns": "a motor turns, in names of tests",
}

_SKIPPED = {"tests/words.py", "tests/words.toml", "tests/test_words.py"}  # they list the words
_ENDINGS = {".py", ".md", ".toml", ".sh", ".conf", ".service", ".rules", ".js", ".css", ".html"}
_FOREIGN = {"vendor", "docs_site", "deploy_kit"}  # folders of what others wrote, or a build copies
_HEAD = """\
# How often the words of words.py may stand in each room; `python -m tests.words --lower` writes this.

[words]
"""
_ALLOWED = re.compile("|".join(ALLOWED))


def _pattern() -> re.Pattern[str]:
    words = [word for group in INSTEAD for word in group.split()]
    titles = "|".join(word.title() for word in words)
    lower, upper, phrases = "|".join(words), "|".join(words).upper(), "|".join(PHRASES)
    snake = rf"(?<![A-Za-z])(?:(?:{lower}|{titles})(?![a-z])|(?:{upper})(?![A-Za-z]))"
    camel = rf"(?<=[a-z0-9])(?:{titles})(?![a-z])"
    return re.compile(rf"{snake}|{camel}|\b(?i:{phrases})\b")


_WORDS = _pattern()


def files() -> Iterator[Path]:
    """Give every file whose words count."""
    for path in sorted(ROOT.glob("*.md")):
        yield path
    for folder in ("gateway", "tests", "docs", "config", "deploy"):
        for path in sorted((ROOT / folder).rglob("*")):
            name = path.relative_to(ROOT)
            if path.suffix in _ENDINGS and str(name) not in _SKIPPED and _FOREIGN.isdisjoint(name.parts):
                yield path


def room_of(path: Path) -> str:
    """Return the room that a file belongs to: a package, a folder, or a single document."""
    parts = path.relative_to(ROOT).parts
    if parts[0] in ("gateway", "tests"):
        return "/".join(parts[:2]) if len(parts) > 2 else f"{parts[0]}/*"
    return "/".join(parts)


def places(text: str) -> Iterator[tuple[int, str]]:
    """Give line number and word of each place in a text; line breaks inside a phrase do not matter."""
    text = _ALLOWED.sub(lambda found: re.sub(r"[^\n]", ".", found[0]), text)
    for found in _WORDS.finditer(text):
        yield text.count("\n", 0, found.start()) + 1, found[0]


def counts() -> dict[str, int]:
    """Return how often the words stand in each room."""
    found: Counter[str] = Counter()
    for path in files():
        found[room_of(path)] += sum(1 for _ in places(path.read_text("utf-8")))
    return dict(found)


def budget() -> dict[str, int]:
    """Return how often the words may stand in each room; not at all in one that is not named."""
    return dict(tomllib.loads(TABLE.read_text("utf-8"))["words"])


def excess() -> list[str]:
    """Return a line for each room with more words than its budget."""
    allowed = budget()
    return [
        f"{room}: {number} words, {allowed.get(room, 0)} allowed (python -m tests.words {room} lists them)"
        for room, number in counts().items()
        if number > allowed.get(room, 0)
    ]


def lower() -> None:
    """Write the present counts into the table where they are lower."""
    present, allowed = counts(), budget() if TABLE.exists() else {}
    rows = {room: min(number, allowed.get(room, number)) for room, number in present.items()}
    lines = [f'"{room}" = {rows[room]}\n' for room in sorted(rows) if rows[room]]
    TABLE.write_text("".join([_HEAD, *lines]), "utf-8")


def _show(names: list[str]) -> None:
    for path in files():
        if any(room_of(path) == name or str(path.relative_to(ROOT)).startswith(name) for name in names):
            lines = path.read_text("utf-8")
            for number, word in places(lines):
                print(f"{path.relative_to(ROOT)}:{number}: {word}: {lines.splitlines()[number - 1].strip()}")


def main(arguments: list[str]) -> int:
    """Print what is too much and return 1, or do as the arguments say."""
    if arguments == ["--lower"]:
        lower()
        return 0
    if arguments:
        _show(arguments)
        return 0
    problems = excess()
    print("\n".join(problems) or "words: within the budget")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
