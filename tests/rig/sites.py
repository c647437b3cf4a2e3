"""Pieces of configurations, to be added up: `SSW07 + ALICE + WEB`."""

from __future__ import annotations

from typing import Any

from gateway.sim.core.power import MotorData

# Motors that start and stop within two seconds, for rows that need not wait: `sim={"pump": QUICK}`.
QUICK = {"motor": MotorData(ramp_up_s=0.6, full_voltage_s=0.2, ramp_down_s=0.4, coast_s=0.5)}


def line(name: str = "pumps", /, **keys: Any) -> str:
    """Return a line; its starters follow it."""
    return "[[line]]\n" + _keys(
        name=name, **{"port": f"/dev/{name}", "baud": 19200, "framing": "8N2", **keys}
    )


def starter(name: str, address: int, family: str, /, **keys: Any) -> str:
    return "[[line.starter]]\n" + _keys(name=name, address=address, family=family, **{"every_s": 1.0, **keys})


def operator(
    client: str, may: tuple[str, ...] = ("*",), starters: tuple[str, ...] = ("*",), **keys: Any
) -> str:
    return "[[operator]]\n" + _keys(client=client, may=list(may), starters=list(starters), **keys)


def table(name: str, /, **keys: Any) -> str:
    """Return any other table: `table("rules", starts_per_hour=2)`, `table("[group]", ...)`."""
    return f"[{name}]\n" + _keys(**keys)


def _keys(**keys: Any) -> str:
    return "".join(f"{key} = {_value(value)}\n" for key, value in keys.items())


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(each) for each in value) + "]"
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_value(each)}" for key, each in value.items()) + " }"
    return f'"{value}"' if isinstance(value, str) else repr(value)


SSW07 = line() + starter("pump", 1, "ssw07")
SSW06 = line() + starter("fan", 2, "ssw06")
SSW900 = line() + starter("mill", 3, "ssw900")
SST = line() + starter("belt", 4, "sst")
FOUR = SSW07 + starter("fan", 2, "ssw06") + starter("mill", 3, "ssw900") + starter("belt", 4, "sst")
SITES = {"pump": SSW07, "fan": SSW06, "mill": SSW900, "belt": SST}  # by the starter's name
ALICE = operator("alice")
WEB = table("web", listen="127.0.0.1:8480")
PASSWORD = "right"
PASSWORD_LINE = "$scrypt$ln=10,r=8,p=1$AAAAAAAAAAAAAAAAAAAAAA$SRIuiwiFOhYpoLr809AJSZaSe9BE7MDdwoMsxwti8nE"
LOGIN = table("[web.user]", name="anna", operator="alice", password=PASSWORD_LINE)  # Anna has Alice's rights
METRICS = table("metrics")
HOME_ASSISTANT = table("homeassistant")
SPARKPLUG = table("sparkplug", group="plant")
