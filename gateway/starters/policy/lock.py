"""The maintenance lock: what it forbids, and what it tells whoever meets it. It replaces no physical lock."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gateway.errors import CommandError
from gateway.records import LockRecord
from gateway.starters.policy.start_rules import is_release

NOTICE = "this replaces no physical lock"
LONGEST_REASON = 256

_HARMLESS = frozenset({"read", "reset", "stop"})  # a reset takes a standing run command back first


def is_forbidden(verb: str, args: Mapping[str, Any]) -> bool:
    """Return whether a lock forbids a command: all but reading, resetting, stopping and releasing."""
    return verb not in _HARMLESS and not is_release(verb, args)


def refusal(lock: LockRecord) -> CommandError:
    """Return why a command is refused while this lock stands."""
    return CommandError("locked", f"locked for maintenance by {owner_of(lock)}: {lock.reason}; {NOTICE}")


def owner_of(lock: LockRecord) -> str:
    """Return who set a lock, for people."""
    return f"{lock.by} ({lock.operator})" if lock.operator else lock.by


def reason_in(args: Mapping[str, Any], reason: str | None) -> str:
    """Return why someone locks: the argument `reason`, else the command's; CommandError without one."""
    strange = sorted(set(args) - {"reason"})
    if strange:
        raise CommandError("bad_arguments", f"{strange[0][:40]!r} is unknown; there is only reason")
    why = args.get("reason", reason)
    if not isinstance(why, str) or not why.strip():
        raise CommandError("bad_arguments", "say why: reason must be a text")
    if len(why) > LONGEST_REASON or not why.isprintable():
        raise CommandError("bad_arguments", f"reason: at most {LONGEST_REASON} printable characters")
    return why.strip()
