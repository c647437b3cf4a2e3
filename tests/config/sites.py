"""A configuration that is right, for tests that make it wrong in one place."""

from __future__ import annotations

from gateway.config.reading import parse
from gateway.config.schema import Config

SITE = """\
[gateway]
name = "mcc1"

[mqtt]
url = "mqtts://broker.plant:8883"

[[line]]
name = "pumps"
port = "/dev/rs485-pumps"
baud = 19200
framing = "8E1"

[[line.starter]]
name = "pump-1"
address = 1
family = "ssw07"

[[line.starter]]
name = "pump-2"
address = 2
family = "ssw900"
every_s = 2.0

[[operator]]
client = "alice"
may = ["start", "stop"]
starters = ["pump-*"]
"""


def site(*changes: tuple[str, str]) -> Config:
    """Return the site, changed."""
    return parse(changed(*changes), "site.toml")


def changed(*changes: tuple[str, str]) -> str:
    """Return the site's text with each first text replaced, once, by the second."""
    text = SITE
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    return text
