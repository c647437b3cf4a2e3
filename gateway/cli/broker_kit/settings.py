"""The options that a kit is made of beside the configuration; stored in it, for updates and the proof."""

from __future__ import annotations

import re
from argparse import ArgumentTypeError, Namespace
from pathlib import Path
from typing import Any, Self

from pydantic import BaseModel, ConfigDict

from gateway.config import Config
from gateway.errors import UsageError

SETTINGS = "kit.json"  # a folder with this file is a kit
LOGIN_NAME = r"(?!\.+(=|$))[A-Za-z0-9_.@-]{1,64}"  # also the name of a file

_HOST = r"(\*\.)?[A-Za-z0-9_]([A-Za-z0-9._-]*[A-Za-z0-9_])?|[0-9A-Fa-f:.]*:[0-9A-Fa-f:.]*"
_PORT = r"([1-9][0-9]{0,3}|[1-5][0-9]{4}|6[0-4][0-9]{3}|65[0-4][0-9]{2}|655[0-2][0-9]|6553[0-5])"
_CENTRAL = rf"[A-Za-z0-9]([A-Za-z0-9._-]*[A-Za-z0-9])?(:{_PORT})?"
_LEVEL = r"([A-Za-z0-9_.-]|\{gateway\})+"
_BASE = f"{_LEVEL}(/{_LEVEL})*"
_FURTHER = f"{LOGIN_NAME}=.+"
_DEFAULT_PORT = 8883


OPTIONS = (  # of the command line: which field of `KitSettings` it sets, by which pattern, and its help
    ("--host", "hosts", "ADDRESS", _HOST, "a name or address in the broker's certificate, beside mqtt.url's"),
    ("--viewer", "viewers", "NAME", LOGIN_NAME, "a login that may only look on; else viewer"),
    ("--auditor", "auditors", "NAME", LOGIN_NAME, "a login that reads events and audit; else auditor"),
    ("--login", "further", "NAME=OPERATOR", _FURTHER, "an operator's login for a second program"),
    ("--bridge", "bridge", "HOST[:PORT]", _CENTRAL, "a central broker: adds a bridge to it"),
    ("--bridge-base", "bridge_base", "BASE", _BASE, "this gateway's base of topics there, else mqtt.base"),
)


class KitSettings(BaseModel):
    """The options."""

    model_config = ConfigDict(frozen=True)

    hosts: tuple[str, ...] = ()
    viewers: tuple[str, ...] = ("viewer",)
    auditors: tuple[str, ...] = ("auditor",)
    further: dict[str, str] = {}  # login: operator
    bridge: str = ""
    bridge_base: str = ""

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Return the options of a kit; UsageError when there is none."""
        try:
            return cls.model_validate_json((folder / SETTINGS).read_text("utf-8"))
        except (OSError, ValueError) as error:
            why = (error.strerror if isinstance(error, OSError) else None) or error
            what = f"{folder / SETTINGS}: no kit that can be read: {why}"
            raise UsageError(f"{what} (write one first)") from error

    def changed(self, args: Namespace) -> Self:
        """Return the options with those of the command line in their place."""
        given: dict[str, Any] = {}
        for name in type(self).model_fields:
            texts = getattr(args, name)
            if texts is not None:
                given[name] = texts if isinstance(texts, str) else tuple(filter(None, texts))
        if "further" in given:
            given["further"] = dict(text.split("=", 1) for text in given["further"])
        return self.model_copy(update=given)

    def central_address(self) -> str:
        """Return host:port of the central broker."""
        return self.bridge if ":" in self.bridge else f"{self.bridge}:{_DEFAULT_PORT}"

    def central_base(self, config: Config) -> str:
        """Return the base of this gateway's topics at the central broker; empty without a bridge."""
        base = (self.bridge_base or config.base).replace("{gateway}", config.gateway.name)
        return base if self.bridge else ""


def checked(text: str, *, pattern: str, metavar: str) -> str:
    """Return a text of an option; argparse reports one that cannot be used. An empty one takes it away."""
    if text and not re.fullmatch(pattern, text):
        raise ArgumentTypeError(f"{text!r} is no {metavar}")
    return text
