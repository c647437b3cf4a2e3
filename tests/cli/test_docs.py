from __future__ import annotations

import socket
import threading
from pathlib import Path
from urllib.request import urlopen

import pytest

from gateway.cli import docs
from gateway.cli.main import main


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "index.html").write_text("<h1>Starter Gateway</h1>", "utf-8")
    monkeypatch.setattr(docs, "SITE", tmp_path)
    return tmp_path


def test_the_documentation_is_served_on_loopback(site: Path) -> None:
    server = docs.server_of(0)
    serving = threading.Thread(target=server.serve_forever)
    serving.start()
    try:
        with urlopen(f"http://127.0.0.1:{server.server_port}/") as answer:
            assert b"Starter Gateway" in answer.read()
    finally:
        server.shutdown()
        serving.join()
        server.server_close()
    assert server.server_address[0] == "127.0.0.1"


def test_a_port_in_use_is_said_with_a_remedy(site: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]

        assert main(["docs", "--port", str(port)]) == 1
    assert f"127.0.0.1:{port}" in (said := capsys.readouterr().err)
    assert "take another --port" in said


def test_a_program_without_its_documentation_says_how_to_build_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(docs, "SITE", tmp_path / "none")

    assert main(["docs"]) == 1
    assert "make site" in capsys.readouterr().err
