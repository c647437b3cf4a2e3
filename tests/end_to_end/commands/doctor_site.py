"""A site for the doctor to look at."""

from __future__ import annotations

from collections.abc import Iterable

from gateway.cli.doctor.machine import DoctorFinding

SITE = """
[gateway]
name = "plant"
state_dir = "{folder}"
[mqtt]
url = "mqtt://127.0.0.1:{port}"
{login}
[[line]]
name = "hall"
port = "/nowhere/tty"
baud = 19200
framing = "8N2"
{starters}
[[operator]]
client = "alice"
may = ["read"]
starters = ["pump*"]
"""


STARTER = '[[line.starter]]\nname = "{name}"\naddress = {address}\nfamily = "{family}"\n'


def site(*families: str, folder: str = "/tmp", port: int = 1, login: str = "") -> str:
    starters = [
        STARTER.format(name=f"pump-{address}", address=address, family=family)
        for address, family in enumerate(families or ("ssw07",), 1)
    ]
    return SITE.format(folder=folder, port=port, login=login, starters="\n".join(starters))


def problems_in(remarks: Iterable[DoctorFinding]) -> list[str]:
    return [f"{remark.where}: {remark.text}" for remark in remarks if remark.is_problem]
