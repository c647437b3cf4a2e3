"""Finds the words that plain technical English does without: `python -m tests.words [PATH ..]`.

A word counts wherever it is: in names (snake_case and CamelCase parts), texts, comments and documents.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]

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

_SKIPPED = {"tests/words.py", "tests/test_words.py"}  # they list the words
_ENDINGS = {".py", ".md", ".toml", ".sh", ".conf", ".service", ".rules", ".js", ".css", ".html"}
_FOREIGN = {"vendor", "docs_site", "deploy_kit"}  # folders of what others wrote, or a build copies
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


def places(text: str) -> Iterator[tuple[int, str]]:
    """Give line number and word of each place in a text; line breaks inside a phrase do not matter."""
    text = _ALLOWED.sub(lambda found: re.sub(r"[^\n]", ".", found[0]), text)
    for found in _WORDS.finditer(text):
        yield text.count("\n", 0, found.start()) + 1, found[0]


def found(beginnings: tuple[str, ...] = ("",)) -> list[str]:
    """Return file, line, word and text of each place in the files that begin so."""
    lines: list[str] = []
    for path in files():
        name, text = str(path.relative_to(ROOT)), path.read_text("utf-8")
        if name.startswith(beginnings):
            shown = text.splitlines()
            lines += [f"{name}:{at}: {word}: {shown[at - 1].strip()}" for at, word in places(text)]
    return lines


def main(paths: list[str]) -> int:
    """Print every place, and return 1 when there is one."""
    lines = found(tuple(paths) or ("",))
    print("\n".join(lines) or "words: none of them")
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
