"""What the answers to one starter's polls say; most say what they said before, and are not decoded again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gateway.families.blocks import Block
from gateway.families.decode import Decoded
from gateway.families.fast_words import rows_from
from gateway.families.schema import Profile, Variant
from gateway.starters.decoding import Sources


@dataclass(frozen=True, slots=True)
class Told:
    """The points that rows tell, and those that they fail to tell."""

    points: Mapping[str, Decoded]
    untold: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Answer:
    """Raw words by code, and what they say; None when that depends on other rows too."""

    rows: Mapping[str, tuple[int, ...]]
    told: Told | None


@dataclass(frozen=True, slots=True)
class _Memory:
    block: Block
    variant: Variant
    value: Sequence[Any]
    answer: Answer


class Answers:
    """Reads the answers of one starter, poll by poll."""

    def __init__(self, profile: Profile, sources: Sources) -> None:
        self._profile = profile
        self._sources = sources
        self._memories: dict[str, _Memory] = {}  # by the poll's key

    def read(self, key: str, block: Block, variant: Variant, value: Sequence[Any]) -> Answer | None:
        """Return what an answer says; None when the mapped words are not ours any more."""
        known = self._memories.get(key)
        if known and known.block is block and known.variant is variant and known.value == value:
            return known.answer
        rows = rows_from(self._profile, block, value)
        if rows is None:
            return None
        told = Told(*self._sources.tell(variant, rows, known={})) if self._sources.are_enough(rows) else None
        answer = Answer(rows, told)
        self._memories[key] = _Memory(block, variant, value, answer)
        return answer
