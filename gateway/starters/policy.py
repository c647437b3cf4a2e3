"""What a site demands of commands beyond what the starters themselves demand, in plain values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from gateway.starters.flood import Limits
from gateway.starters.rules import RuleSet


@dataclass(frozen=True, slots=True)
class Policy:
    """The rules by starter, the groups by name, and what is too much."""

    rules: Mapping[str, RuleSet] = field(default_factory=dict)
    groups: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    limits: Limits = field(default_factory=Limits)
