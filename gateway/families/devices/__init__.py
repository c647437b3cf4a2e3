"""The behaviour of each family beyond its profile: one file each, named as its folder. Start at `device`."""

from __future__ import annotations

import importlib

from gateway.families.devices.device import Device
from gateway.families.profile.load import FAMILIES
from gateway.families.profile.schema import Profile

DEVICES: dict[str, Device] = {
    family: importlib.import_module(f"gateway.families.devices.{family}").DEVICE for family in FAMILIES
}

_PLAIN = Device()


def device_of(profile: Profile) -> Device:
    """Return the device of a profile's family; a profile that is not shipped has nothing of its own."""
    return DEVICES.get(profile.family, _PLAIN)
