"""A site with a Sparkplug node and its passwords, on the disk."""

from __future__ import annotations

from pathlib import Path

from gateway.app.site import Site

SITE = """
[gateway]
name = "mcc1"

[mqtt]
url = "mqtt://localhost:1884"
username = "gateway"
password_file = "main.password"

[[line]]
name = "hall"
port = "/dev/null"
baud = 19200
framing = "8N2"
[[line.starter]]
name = "pump"
address = 1
family = "ssw07"

[[operator]]
client = "scada"
may = ["start", "stop"]
starters = ["*"]
"""


def site(folder: Path, table: str) -> Site:
    for name in ("main.password", "own.password"):
        (folder / name).write_text(f"secret of {name}\n", "utf-8")
        (folder / name).chmod(0o600)
    (folder / "site.toml").write_text(SITE + table, "utf-8")
    return Site.read(folder / "site.toml", {})
