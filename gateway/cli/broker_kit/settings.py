"""The options that a kit is made of beside the configuration; stored in it, for updates and the proof."""

from __future__ import annotations

import re
from argparse import Namespace
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Self

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict

from gateway.config import Config
from gateway.errors import UsageError

SETTINGS = "kit.json"  # a folder with this file is a kit
DEFAULT_PORT = 8883
LOGIN_NAME = r"(?!\.+$)[A-Za-z0-9_.@-]{1,64}"  # also the name of a file

_HOST = r"(\*\.)?[A-Za-z0-9_]([A-Za-z0-9._-]*[A-Za-z0-9_])?|[0-9A-Fa-f:.]*:[0-9A-Fa-f:.]*"
_CENTRAL = r"([A-Za-z0-9]([A-Za-z0-9._-]*[A-Za-z0-9])?(:[0-9]{1,5})?)?"
_LEVEL = r"([A-Za-z0-9_.-]|\{gateway\})+"


def _like(pattern: str, what: str) -> AfterValidator:
    """Return the check of an option's text."""

    def check(text: str) -> str:
        if not re.fullmatch(pattern, text):
            raise UsageError(f"{text!r} is {what}")
        return text

    return AfterValidator(check)


def _pairs(texts: Iterable[str] | dict[str, str]) -> dict[str, str]:
    """Return the logins of NAME=OPERATOR texts, as an option gives them."""
    if isinstance(texts, dict):
        return texts
    pairs = {text: text.partition("=")[::2] for text in texts if text}
    for text, names in pairs.items():
        if not all(names):
            raise UsageError(f"--login {text!r} is not NAME=OPERATOR (e.g. alice-send=alice)")
    return dict(pairs.values())


def _given(texts: Iterable[str]) -> tuple[str, ...]:
    return tuple(filter(None, texts))


Host = Annotated[str, _like(_HOST, "no name or address of a broker")]
LoginName = Annotated[str, _like(LOGIN_NAME, "no name for a login (a-z, 0-9, _ . @ and -)")]


class KitSettings(BaseModel):
    """The options; an empty text takes away the stored ones. UsageError for what is none."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    hosts: Annotated[tuple[Host, ...], BeforeValidator(_given)] = ()
    viewers: Annotated[tuple[LoginName, ...], BeforeValidator(_given)] = ("viewer",)
    auditors: Annotated[tuple[LoginName, ...], BeforeValidator(_given)] = ("auditor",)
    further: Annotated[dict[LoginName, str], BeforeValidator(_pairs)] = {}  # login: operator
    bridge: Annotated[str, _like(_CENTRAL, "no HOST[:PORT] (a name, or an IPv4 address)")] = ""
    bridge_base: Annotated[
        str, _like(f"({_LEVEL}(/{_LEVEL})*)?", "no base of topics (levels of a-z, A-Z, 0-9, _ . and -)")
    ] = ""
    has_bridge_ca: bool = False

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
        given = {name: getattr(args, name, None) for name in type(self).model_fields}
        if args.bridge_ca is not None:
            given["has_bridge_ca"] = bool(args.bridge_ca)
        return self.model_validate(
            {**self.model_dump(), **{k: value for k, value in given.items() if value is not None}}
        )

    def central_address(self) -> str:
        """Return host:port of the central broker; UsageError for a port that there is not."""
        host, _, port = self.bridge.partition(":")
        if not 0 < int(port or DEFAULT_PORT) < 65536:
            raise UsageError(f"--bridge {self.bridge!r} is no HOST[:PORT] (a port is 1 to 65535)")
        return f"{host}:{port or DEFAULT_PORT}"

    def central_base(self, config: Config) -> str:
        """Return the base of this gateway's topics at the central broker; empty without a bridge."""
        base = (self.bridge_base or config.base).replace("{gateway}", config.gateway.name)
        return base if self.bridge else ""
