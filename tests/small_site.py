"""The configuration of a small plant, for tests to which no more matters than its starters."""

from __future__ import annotations

_SITE = """\
[gateway]
name = "plant"
state_dir = "state"

[mqtt]
url = "mqtt://127.0.0.1"

[[line]]
name = "hall"
port = "/nowhere/tty"
baud = 19200
framing = "8N2"
"""
_STARTER = """
[[line.starter]]
name = "{name}"
address = {address}
family = "{family}"
"""


def small_site(*starters: tuple[str, str], more: str = "") -> str:
    """Return its text; the starters, by name and family, have the addresses from 1, `more` is of the last."""
    tables = [
        _STARTER.format(name=name, address=address, family=family)
        for address, (name, family) in enumerate(starters, 1)
    ]
    return "".join((_SITE, *tables, more))
