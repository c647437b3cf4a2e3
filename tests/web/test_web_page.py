"""The page beside everything else: alone with its faults, and nothing of it where it is not wanted."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from gateway.plugins.web.plugin import settings_of
from gateway.plugins.web.static_files import read_files
from tests.config.sites import site

TABLE = '[[operator]]\nclient = "alice"'


def test_the_gateway_itself_imports_neither_web_server_nor_prometheus() -> None:
    unwanted = {"starlette", "uvicorn", "h11", "prometheus_client"}
    code = f"import sys, gateway.cli.run; print({unwanted} & set(sys.modules))"

    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    assert found.stdout.strip() == "set()"


def test_the_first_view_of_the_page_with_its_plots_stays_under_100_kilobytes() -> None:
    files = read_files()

    assert {"index.html", "style.css", "app.js"} <= files.keys()
    assert sum(len(each.compressed) for each in files.values()) < 100_000  # uPlot's two, where it is built in


def test_settings_are_plain_values_with_paths_below_the_configurations_folder() -> None:
    config = site((TABLE, f'[web]\ncert_file = "c.pem"\nkey_file = "/k.pem"\nbase_path = "/x"\n{TABLE}'))
    read: Any = SimpleNamespace(config=config, folder=Path("/etc/gw"), path=None, computed={})

    settings = settings_of(read)

    assert settings is not None
    assert (settings.cert_file, settings.key_file) == ("/etc/gw/c.pem", "/k.pem")
    assert settings.url == "https://127.0.0.1:8480/x/"
    assert settings.is_tls
