"""What single values of the configuration may be: patterns, types, addresses; and what all tables share."""

from __future__ import annotations

import difflib
import ipaddress
import posixpath
import re
from datetime import date, time
from typing import Annotated, Any, Self
from urllib.parse import SplitResult, urlsplit

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ModelWrapValidatorHandler,
    ValidationInfo,
    model_validator,
)
from pydantic_core import PydanticCustomError

NAME_PATTERN = r"^[a-z0-9_-]+$"
FIRMWARE_PATTERN = r"^\d{1,2}\.\d{1,2}$"
GLOB_PATTERN = r"^[a-z0-9_*?-]+$"
USER_PATTERN = r"^[A-Za-z0-9_.@-]+$"
HOST_PATTERN = r"^[A-Za-z0-9]([A-Za-z0-9.-]*[A-Za-z0-9])?$"
PROM_FILE_PATTERN = r"^[^\x00]*[^/\x00]\.prom$"
BASE_PATH_PATTERN = r"^/([A-Za-z0-9_.~-]+/?)*$"
TOPIC_PATTERN = r"^[A-Za-z0-9_.-]+(/[A-Za-z0-9_.-]+)*$"
URL_PATTERN = r"^https?://[^\s/]+(/\S*)?$"
ROW_CODE_PATTERN = r"^[A-Z][A-Z0-9]*(\.[0-9]+)*$"
ROW_PATTERN_PATTERN = r"^[A-Za-z0-9.*?]+$"
POINT_NAME_PATTERN = r"^[a-z][a-z0-9_]*$"
SPARKPLUG_ID_PATTERN = r"^[^+/#\x00-\x1f\x7f]+$"
SCHEMES = {"mqtt": 1883, "mqtts": 8883}

Name = Annotated[str, Field(pattern=NAME_PATTERN, max_length=64)]
Glob = Annotated[str, Field(pattern=GLOB_PATTERN, max_length=64)]
HostName = Annotated[str, Field(pattern=HOST_PATTERN, max_length=253)]
Text = Annotated[str, Field(min_length=1, max_length=1024)]
RowCode = Annotated[str, Field(pattern=ROW_CODE_PATTERN, max_length=32)]
RowPattern = Annotated[str, Field(pattern=ROW_PATTERN_PATTERN, max_length=32)]
PointName = Annotated[str, Field(pattern=POINT_NAME_PATTERN, max_length=64)]
SparkplugId = Annotated[str, Field(pattern=SPARKPLUG_ID_PATTERN, max_length=128)]


def wrong(what: str, hint: str) -> PydanticCustomError:
    """Return the error of a value, with a hint."""
    return PydanticCustomError("wrong", "{what}", {"what": what, "hint": hint})


def short(value: object) -> str:
    """Return a foreign value for a message: quoted, and cut when it is long."""
    if isinstance(value, bool):
        return str(value).lower()
    text = str(value) if isinstance(value, (date, time)) else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def split_url(url: str) -> tuple[SplitResult, int] | None:
    """Return the parts and the port of a broker's URL, or None when it is not one."""
    try:
        split = urlsplit(url)
        port = split.port
    except ValueError:
        return None
    if split.scheme not in SCHEMES or not split.hostname or port == 0:
        return None
    return split, port or SCHEMES[split.scheme]


def split_listen(listen: str) -> tuple[str, int] | None:
    """Return address and port to listen on, or None when that is no IP address with a port."""
    host, _, port = listen.rpartition(":")
    is_bracketed = host.startswith("[") and host.endswith("]")
    try:
        address = ipaddress.ip_address(host[1:-1] if is_bracketed else host)
    except ValueError:
        return None
    is_right = port.isascii() and port.isdigit() and int(port) <= 0xFFFF
    return (str(address), int(port)) if is_right and is_bracketed == (address.version == 6) else None


def is_loopback(host: str) -> bool:
    """Return whether a host name or address never leaves this machine."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _as_broker(url: str) -> str:
    parts = split_url(url)
    if parts is None:
        scheme = url.partition("://")[0]
        near = [] if scheme in SCHEMES else difflib.get_close_matches(scheme, SCHEMES, n=1)
        hint = f"did you mean {near[0]}?" if near else "mqtts://host:8883"
        raise wrong(f"{short(re.sub(r'[^/]*@', '...@', url))} is no broker address", hint)
    split, _port = parts
    if split.username is not None or split.password is not None:
        raise wrong("holds a login", "use username and password_file")
    if split.path not in ("", "/") or split.query or split.fragment:
        raise wrong("has more than a host and a port", "leave out what follows the port")
    return url


def _as_base(base: str) -> str:
    for level in base.replace("{gateway}", "x").split("/"):
        if not re.fullmatch(NAME_PATTERN[1:-1], level):
            what = f"has the level {short(level)}" if level else "has an empty level"
            raise wrong(what, "only a-z, 0-9, _ and - between slashes, and {gateway}")
    return base


def _as_port(port: str) -> str:
    socket = _SOCKET.fullmatch(port)
    if not posixpath.isabs(port) and (socket is None or not 0 < int(socket[1]) <= 0xFFFF):
        hint = "an absolute path such as /dev/serial/by-id/..., or socket://host:port"
        raise wrong(f"{short(port)} is no port", hint)
    return port


def _as_listen(listen: str) -> str:
    if split_listen(listen) is None:
        hint = "address:port, such as 127.0.0.1:8480 or [::1]:8480; 0.0.0.0 for all addresses"
        raise wrong(f"{short(listen)} is no address with a port", hint)
    return listen


def _as_title(title: str) -> str:
    if not title.isprintable() or title.isspace():
        raise wrong(f"{short(title)} cannot be printed", "letters, digits, signs and spaces, in one line")
    return title


def _as_network(text: str) -> str:
    try:
        ipaddress.ip_network(text, strict=False)
    except ValueError:
        hint = "an address or network such as 192.0.2.7 or 10.0.0.0/8"
        raise wrong(f"{short(text)} is no address", hint) from None
    return text


def _as_path(path: str) -> str:
    if not {".", ".."}.isdisjoint(path.split("/")):
        hint = "a path such as /mcc1: browsers resolve . and .. before they ask"
        raise wrong(f"{short(path)} has a level . or ..", hint)
    return path


_SOCKET = re.compile(r"socket://[^\s:/]+:(\d{1,5})")
BrokerUrl = Annotated[Text, AfterValidator(_as_broker)]
Base = Annotated[Text, AfterValidator(_as_base)]
Port = Annotated[Text, AfterValidator(_as_port)]
Listen = Annotated[Text, AfterValidator(_as_listen)]
Title = Annotated[str, Field(min_length=1, max_length=60), AfterValidator(_as_title)]
Network = Annotated[Text, AfterValidator(_as_network)]
PagePath = Annotated[str, Field(pattern=BASE_PATH_PATTERN, max_length=128), AfterValidator(_as_path)]


class ConfigTable(BaseModel):
    """What all tables share: no unknown key, no silent conversion, nothing changes after loading."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    @model_validator(mode="wrap")
    @classmethod
    def _keep(cls, given: Any, handler: ModelWrapValidatorHandler[Self], info: ValidationInfo) -> Self:
        """Note a table that is right by itself in the context, by the identity of what it is made of."""
        table = handler(given)
        if info.context is not None:
            info.context[id(given)] = table
        return table
