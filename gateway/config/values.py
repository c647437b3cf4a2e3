"""What single values of the configuration may be: patterns, types, addresses; and what all tables share."""

from __future__ import annotations

import ipaddress
from typing import TYPE_CHECKING, Annotated, Literal
from urllib.parse import SplitResult, urlsplit

from pydantic import BaseModel, ConfigDict, Field

from gateway.families import FAMILIES, LANGUAGES

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

if TYPE_CHECKING:
    Family = str
    Language = str
else:
    Family = Literal[FAMILIES]  # whatever profiles there are
    Language = Literal[LANGUAGES]
Name = Annotated[str, Field(pattern=NAME_PATTERN, max_length=64)]
Glob = Annotated[str, Field(pattern=GLOB_PATTERN, max_length=64)]
HostName = Annotated[str, Field(pattern=HOST_PATTERN, max_length=253)]
Text = Annotated[str, Field(min_length=1, max_length=1024)]
RowCode = Annotated[str, Field(pattern=ROW_CODE_PATTERN, max_length=32)]
RowPattern = Annotated[str, Field(pattern=ROW_PATTERN_PATTERN, max_length=32)]
PointName = Annotated[str, Field(pattern=POINT_NAME_PATTERN, max_length=64)]
SparkplugId = Annotated[str, Field(pattern=SPARKPLUG_ID_PATTERN, max_length=128)]


class ConfigTable(BaseModel):
    """What all tables share: no unknown key, no silent conversion, nothing changes after loading."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


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
