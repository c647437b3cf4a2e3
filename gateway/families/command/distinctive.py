"""The rows that distinguish a family: they are part of each reading on which a command decides.

An SSW-07 has none: its status row excludes an SSW900 and an SST, and its coil 100 means run on an SSW-06 too.
"""

from __future__ import annotations

from dataclasses import replace

from gateway.families.devices import device_of
from gateway.families.profile.procedure import Preparation, Seen
from gateway.families.profile.schema import Profile
from gateway.families.reading import with_rows


def distinctive_rows(profile: Profile) -> tuple[str, ...]:
    """Return the rows that a device of another family does not have, or in which it has other numbers."""
    return device_of(profile).distinctive_rows


def contradiction(profile: Profile, seen: Seen) -> str:
    """Return in words how the rows seen deny this family; empty when they do not, or were not seen."""
    codes = distinctive_rows(profile)
    if not seen.keys() >= set(codes) or device_of(profile).is_like(seen):
        return ""
    shown = " and ".join(f"{code} is {seen[code][0]}" for code in codes)
    return f"it is not {profile.family}: {shown}"


def with_distinctive_rows(profile: Profile, preparation: Preparation) -> Preparation:
    """Return a preparation whose reading also shows whether the device is of another family."""
    return replace(preparation, reads=with_rows(profile, preparation.reads, distinctive_rows(profile)))
