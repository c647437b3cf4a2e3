"""What hosts write, in a few words."""

from __future__ import annotations

from typing import Any

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
