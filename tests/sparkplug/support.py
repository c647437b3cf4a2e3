"""Records of a starter, and what hosts write, in a few words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gateway.contract import (
    AlarmRecord,
    AvailabilityRecord,
    InfoRecord,
    LineRecord,
    LockRecord,
    Quality,
    StateRecord,
    ValueRecord,
)
from tests.rig.sparkplug import block_of

EPOCH_S = 1_760_000_000.0
FIELDS = {  # of a metric [Sparkplug 3.0, 6.4]
    "name": 1,
    "timestamp": 3,
    "datatype": 4,
    "is_historical": 5,
    "is_null": 7,
    "int_value": 10,
    "long_value": 11,
    "boolean_value": 14,
    "string_value": 15,
    "bytes_value": 16,
    "dataset_value": 17,
    "template_value": 18,
    "extension_value": 19,
}


def info(starter: str, **changes: Any) -> InfoRecord:
    given: dict[str, Any] = {
        "family": "ssw07",
        "model": "SSW-07 130A",
        "firmware": "1.30",
        "serial": "77",
        "line": "hall",
        "address": 1,
        "points": {"current": {"type": "float", "unit": "A", "name": "Motor current"}},
        "commands": ("start", "stop", "reset", "set", "select"),
        **changes,
    }
    return InfoRecord(starter=starter, **given)


def availability(starter: str, state: str, time_s: float, reason: str | None = None) -> AvailabilityRecord:
    return AvailabilityRecord(starter=starter, state=state, since_s=time_s, reason=reason)


def value(
    starter: str,
    point: str,
    is_: Any,
    *,
    quality: Quality = Quality.GOOD,
    time_s: float | None = EPOCH_S + 50.0,
) -> ValueRecord:
    return ValueRecord(
        starter=starter, point=point, value=is_, unit="A", quality=quality, time_s=time_s, seq=1
    )


def state(
    starter: str, name: str = "ready", *, lock: LockRecord | None = None, **flags: bool | None
) -> StateRecord:
    return StateRecord(
        starter=starter,
        state=name,
        quality=Quality.GOOD,
        time_s=EPOCH_S + 60.0,
        seq=1,
        flags=flags,
        lock=lock,
    )


def alarm(starter: str, code: str, *, is_active: bool = True, severity: str = "fault") -> AlarmRecord:
    cleared_s = None if is_active else EPOCH_S + 90.0
    return AlarmRecord(
        starter=starter,
        code=code,
        is_active=is_active,
        severity=severity,
        text=f"text of {code}",
        time_s=EPOCH_S + 80.0,
        cleared_s=cleared_s,
        count=1,
        seq=1,
    )


def line(statistics: Mapping[str, Any]) -> LineRecord:
    return LineRecord(line="hall", data=statistics)


def dcmd(*writes: dict[str, Any], time_s: float | None = EPOCH_S + 100.0) -> bytes:
    """Return a DCMD as a host writes it."""
    time = b"" if time_s is None else block_of({1: round(time_s * 1000)})
    return time + b"".join(
        block_of({2: block_of({FIELDS[n]: v for n, v in each.items()})}) for each in writes
    )


def write(name: str, value: bool = True, **more: Any) -> dict[str, Any]:
    """Return one metric of a DCMD."""
    return {"name": name, "boolean_value": value, **more}


def host_says(online: bool, timestamp: int) -> bytes:
    return f'{{"online": {str(online).lower()}, "timestamp": {timestamp}}}'.encode()
