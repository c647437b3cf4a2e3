"""What single values of the configuration may be: patterns, types, addresses; and what all tables share."""

from __future__ import annotations

import difflib
import ipaddress
import posixpath
import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, TypeVar
from urllib.parse import SplitResult, urlsplit

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    field_validator,
)
from pydantic.fields import FieldInfo

from gateway.config.mistakes import Key, Mistake, WrongValueError, short, wrong

SCHEMES = {"mqtt": 1883, "mqtts": 8883}
_CERTIFICATE = "a certificate and its key go together"

T = TypeVar("T")
Several = Annotated[tuple[T, ...], Field(strict=False)]  # a list in TOML
PATTERN_HINTS: dict[str, str] = {}  # what a text of each pattern must be, in words


def _text(pattern: str, most: int, hint: str) -> FieldInfo:
    """Return what a text of a pattern is limited to, and note its hint."""
    PATTERN_HINTS[pattern] = hint
    field: FieldInfo = Field(pattern=pattern, max_length=most)
    return field


_LEVEL = r"([a-z0-9_-]|\{gateway\})+"
_BASE_PATTERN = rf"^{_LEVEL}(/{_LEVEL})*$"
_PATH_PATTERN = r"^/([A-Za-z0-9_~-][A-Za-z0-9_.~-]*/?)*$"  # browsers resolve . and .. before they ask
_TOPIC_PATTERN = r"^[A-Za-z0-9_.-]+(/[A-Za-z0-9_.-]+)*$"
_HOST_PATTERN = r"^[A-Za-z0-9]([A-Za-z0-9.-]*[A-Za-z0-9])?$"

Text = Annotated[str, Field(min_length=1, max_length=1024)]
Name = Annotated[str, _text(r"^[a-z0-9_-]+$", 64, "only a-z, 0-9, _ and -")]
Glob = Annotated[str, _text(r"^[a-z0-9_*?-]+$", 64, "only a-z, 0-9, _ and -, and * or ? for any others")]
User = Annotated[str, _text(r"^[A-Za-z0-9_.@-]+$", 64, "only letters, digits, _ . @ and -")]
Firmware = Annotated[str, _text(r"^\d{1,2}\.\d{1,2}$", 5, "two numbers with a point, such as 1.30")]
Topic = Annotated[str, _text(_TOPIC_PATTERN, 128, "levels with only letters, digits, _ . and -: home/status")]
Base = Annotated[str, _text(_BASE_PATTERN, 1024, "only a-z, 0-9, _ and - between slashes, and {gateway}")]
PagePath = Annotated[str, _text(_PATH_PATTERN, 128, "a path such as /mcc1, no level beginning with a point")]
Url = Annotated[str, _text(r"^https?://[^\s/]+(/\S*)?$", 256, "it begins with http:// or https://")]
PromFile = Annotated[str, _text(r"^[^\x00]*[^/\x00]\.prom$", 1024, "a file's name that ends in .prom")]
HostName = Annotated[str, _text(_HOST_PATTERN, 253, "a name or address without port, such as mcc1.plant")]
RowCode = Annotated[str, _text(r"^[A-Z][A-Z0-9]*(\.[0-9]+)*$", 32, "a code in capitals such as P102")]
RowPattern = Annotated[str, _text(r"^[A-Za-z0-9.*?]+$", 32, "a code such as S1.1.1, with * and ? for others")]
PointName = Annotated[str, _text(r"^[a-z][a-z0-9_]*$", 64, "a letter, then only a-z, 0-9 and _")]
SparkplugId = Annotated[str, _text(r"^[^+/#\x00-\x1f\x7f]+$", 128, "a topic's level, without +, / and #")]


def split_url(url: str) -> tuple[SplitResult, int] | None:
    """Return the parts and the port of a broker's URL, or None when it is not one; a login is no part."""
    try:
        split = urlsplit(url)
        port = split.port
    except ValueError:
        return None
    more = "@" in split.netloc or split.path not in ("", "/") or split.query or split.fragment
    if more or split.scheme not in SCHEMES or not split.hostname or port == 0:
        return None
    return split, port or SCHEMES[split.scheme]


def split_listen(listen: str) -> tuple[str, int] | None:
    """Return address and port to listen on, or None when that is no IP address with a port."""
    try:
        split = urlsplit(f"//{listen}")
        address, port = ipaddress.ip_address(split.hostname or ""), split.port
    except ValueError:
        return None
    return None if port is None or "@" in listen or split.netloc != listen else (str(address), port)


def is_loopback(host: str) -> bool:
    """Return whether a host name or address never leaves this machine."""
    with suppress(ValueError):
        return ipaddress.ip_address(host).is_loopback
    return host == "localhost"


def _is_port(port: str) -> bool:
    socket = _SOCKET.fullmatch(port)
    return posixpath.isabs(port) or (socket is not None and 0 < int(socket[1]) <= 0xFFFF)


def _is_title(title: str) -> bool:
    return title.isprintable() and not title.isspace()


def _only(is_right: Callable[[str], object], what: str, hint: str) -> AfterValidator:
    """Return the check of a text, which `what` shows at {}: it is wrong too where it raises ValueError."""

    def check(text: str) -> str:
        with suppress(ValueError):
            if is_right(text):
                return text
        raise wrong(what.format(short(text)), hint)

    return AfterValidator(check)


_SOCKET = re.compile(r"socket://[^\s:/]+:(\d{1,5})")
_LOGIN = "mqtts://host:8883; a login goes into username and password_file"
BrokerUrl = Annotated[Text, _only(split_url, "is no broker address", _LOGIN)]  # a password may be in it
Port = Annotated[
    Text, _only(_is_port, "{} is no port", "such as /dev/serial/by-id/... or socket://host:port")
]
Listen = Annotated[Text, _only(split_listen, "{} is no address with a port", "127.0.0.1:8480 or [::1]:8480")]
_Line = Annotated[str, Field(min_length=1, max_length=60)]
Title = Annotated[_Line, _only(_is_title, "{} cannot be printed", "letters, digits, signs and spaces")]
Network = Annotated[
    Text,
    _only(partial(ipaddress.ip_network, strict=False), "{} is no address", "such as 192.0.2.7 or 10.0.0.0/8"),
]


class ConfigTable(BaseModel):
    """What all tables share: no unknown key, no silent conversion, nothing changes after loading."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)
    NEEDS: ClassVar[tuple[tuple[str, str, str], ...]] = (  # a key, the key that it needs beside it, and why
        ("cert_file", "key_file", _CERTIFICATE),
        ("key_file", "cert_file", _CERTIFICATE),
        ("password_file", "username", "a password belongs to a user"),
        ("commands", "operator", "name the [[operator]] whose rights these commands have"),
    )

    def contradictions(self) -> Iterator[Mistake]:
        """Yield what contradicts something else in this table, by keys that begin below it."""
        for name, other, why in self.NEEDS:
            if vars(self).get(name) and not vars(self).get(other, "taken out"):
                yield Mistake((name,), f"needs {other} beside it", why)

    def tables(self, key: Key = ()) -> Iterator[tuple[Key, ConfigTable]]:
        """Yield this table and all within it, with their keys."""
        yield key, self
        for name, field in type(self).model_fields.items():
            value, at = self.__dict__.get(name), (*key, field.alias or name)
            if isinstance(value, ConfigTable):
                yield from value.tables(at)
            for place, item in enumerate(value if isinstance(value, tuple) else ()):
                if isinstance(item, ConfigTable):
                    yield from item.tables((*at, place))

    def forget(self, key: object) -> None:
        """Take a wrong value out; of an unknown key those not given that it may be, misspelt."""
        names = {field.alias or name: name for name, field in type(self).model_fields.items()}
        unset = [known for known, name in names.items() if name not in self.model_fields_set]
        for known in [str(key)] if key in names else difflib.get_close_matches(str(key).lower(), unset):
            self.__dict__.pop(names[known], None)

    if not TYPE_CHECKING:  # for which every name would be known then

        def __getattr__(self, name: str) -> Any:
            """Raise WrongValueError for a value that was taken out."""
            if name in type(self).model_fields:
                raise WrongValueError(name)
            return super().__getattr__(name)

    @field_validator("*", mode="wrap")
    @classmethod
    def _let_pass(cls, value: Any, validate: ValidatorFunctionWrapHandler, info: ValidationInfo) -> Any:
        """Let a wrong value pass as None where the tables are to be read in spite of it (`context`)."""
        try:
            return validate(value)
        except ValidationError:
            if not info.context:
                raise
            return None
