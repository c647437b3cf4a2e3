"""What starters at rest say."""

from __future__ import annotations

from typing import Any

from gateway.families.profile.state import STARTING

WEG_AT_REST: dict[str, Any] = {
    **dict.fromkeys(
        ("running", "jog", "accelerating", "decelerating", "braking", "reversing", "fault"), False
    ),
    **dict.fromkeys(STARTING, False),
    "general_enabled": True,
    "power_present": True,
}


SST_AT_REST: dict[str, Any] = {
    **dict.fromkeys(("fault", "running", "accelerating", "full_voltage", "decelerating"), False),
    "configured": True,
    "ready_to_start": True,
}
