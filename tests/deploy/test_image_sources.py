"""Beside the image, which tests/packages builds and runs: its health check, and the example for compose."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import pytest
import yaml

TOP = Path(__file__).parents[2]
OCI = TOP / "deploy" / "oci"
HEALTHY = runpy.run_path(str(OCI / "healthy.py"))
COMPOSE = yaml.safe_load((OCI / "compose.yaml").read_text("utf-8"))


@pytest.mark.parametrize(
    ("site", "url"),
    [
        ("", None),
        ("[web]", "http://127.0.0.1:8480/health"),
        ('[web]\nlisten = "0.0.0.0:9000"\nallow_plaintext = true', "http://127.0.0.1:9000/health"),
        ('[web]\nlisten = "[::]:8480"\ncert_file = "a.pem"', "https://127.0.0.1:8480/health"),
        ('[web]\nlisten = "192.0.2.7:8480"\nbase_path = "/mcc1/"', "http://192.0.2.7:8480/mcc1/health"),
    ],
)
def test_the_health_check_asks_where_the_page_listens(site: str, url: str | None) -> None:
    assert HEALTHY["health_url"](site) == url


def test_the_example_for_compose_mounts_what_exists_and_gives_the_gateway_little() -> None:
    gateway: dict[str, Any] = COMPOSE["services"]["gateway"]
    mounted = [
        volume.split(":")[0]
        for service in COMPOSE["services"].values()
        for volume in service["volumes"]
        if volume.startswith(".") and not volume.startswith("./site")
    ]

    assert mounted
    assert [path for path in mounted if not (OCI / path).exists()] == []
    assert (OCI / gateway["build"]["context"] / gateway["build"]["dockerfile"]).samefile(
        OCI / "Containerfile"
    )
    assert (gateway["read_only"], gateway["cap_drop"]) == (True, ["ALL"])
    named = {volume.split(":")[0] for each in COMPOSE["services"].values() for volume in each["volumes"]}
    assert {name for name in named if not name.startswith(".")} == set(COMPOSE["volumes"])
