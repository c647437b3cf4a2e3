"""A site's rules for starts, each refusal with its reading and its hint, and its limits, in plain values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from gateway.contract import CommandError, ResultCode
from gateway.families import to_switch
from gateway.starters.policy.motor_history import MotorHistory

HOUR_S = 3600.0


@dataclass(frozen=True, slots=True)
class RuleSet:
    """What is configured for one starter; nothing by default, in any family."""

    starts_per_hour: int | None = None  # local ones count as well
    minimum_pause_s: float = 0.0  # between standstill and the next start
    feeder: str = ""  # starters that must not start at the same time, on whatever lines
    stagger_s: float = 0.0  # between another's start on the feeder and one of this starter
    two_step: frozenset[str] = field(default_factory=frozenset)  # verbs that must be selected first

    @property
    def is_counting(self) -> bool:
        """Return whether a start depends on the record of earlier ones."""
        return self.starts_per_hour is not None or self.minimum_pause_s > 0 or self.stagger_s > 0


NO_RULES = RuleSet()


def is_start(verb: str, args: Mapping[str, Any]) -> bool:
    """Return whether a command makes the motor run."""
    return verb == "start" or (verb == "jog" and not is_release(verb, args))


def is_release(verb: str, args: Mapping[str, Any]) -> bool:
    """Return whether a command only takes a jog or the general enable back."""
    return verb in ("jog", "general_enable") and to_switch(args.get("value")) is False


@dataclass(frozen=True, slots=True)
class PolicySettings:
    """The rules by starter, and the groups by name."""

    rules: Mapping[str, RuleSet] = field(default_factory=dict)
    groups: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def of(self, starter: str) -> RuleSet:
        """Return the rules of a starter."""
        return self.rules.get(starter, NO_RULES)


def demand_start(settings: PolicySettings, history: MotorHistory, starter: str, *, now_s: float) -> None:
    """Raise CommandError for the first rule that forbids a start now, by what is known of earlier ones."""
    rules = settings.of(starter)
    if rules.starts_per_hour is not None:
        most, starts = rules.starts_per_hour, history.starts_since(starter, now_s - HOUR_S)
        if len(starts) >= most:
            wait_s = starts[-most] + HOUR_S - now_s
            raise CommandError(ResultCode.TOO_MANY_STARTS, count=len(starts), most=most, wait_s=wait_s)
    pause_s = rules.minimum_pause_s
    if pause_s > 0:
        since_s = history.standing_since(starter)
        if since_s is None:
            raise CommandError(ResultCode.PAUSE_TOO_SHORT, "unseen")
        standing_s, wait_s = now_s - since_s, since_s + pause_s - now_s
        if wait_s > 0:
            raise CommandError(
                ResultCode.PAUSE_TOO_SHORT, "pause", standing_s=standing_s, pause_s=pause_s, wait_s=wait_s
            )
    others = [n for n, other in settings.rules.items() if other.feeder == rules.feeder and n != starter]
    for other in others if rules.feeder and rules.stagger_s > 0 else ():
        for start_s in history.starts_since(other, now_s - rules.stagger_s):
            ago_s, wait_s = now_s - start_s, start_s + rules.stagger_s - now_s
            raise CommandError(
                ResultCode.FEEDER_BUSY, other=other, ago_s=ago_s, feeder=rules.feeder, wait_s=wait_s
            )
