"""How pip builds the wheel from a checkout, which holds neither uPlot nor the documentation as a site."""

from __future__ import annotations

import runpy
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from deploy.wheel import BACKEND, TOP


@pytest.fixture
def checkout(tmp_path: Path) -> Any:
    """Return the backend of a folder in which nothing can be fetched."""
    shutil.copytree(BACKEND, tmp_path / BACKEND.relative_to(TOP))
    (tmp_path / "gateway" / "system").mkdir(parents=True)
    for name in ("__init__.py", "system/version.py"):
        shutil.copyfile(TOP / "gateway" / name, tmp_path / "gateway" / name)
    script = tmp_path / "deploy" / "get-uplot.sh"
    script.write_text("#!/bin/sh\necho no network >&2\n", "utf-8")
    script.chmod(0o755)
    return SimpleNamespace(**runpy.run_path(str(next(tmp_path.rglob("with_page_and_docs.py")))))


@pytest.fixture(autouse=True)
def _setuptools(monkeypatch: pytest.MonkeyPatch) -> None:
    from setuptools import build_meta

    monkeypatch.setattr(build_meta, "get_requires_for_build_wheel", lambda _: [])
    monkeypatch.setattr(build_meta, "build_wheel", lambda *_: "the.whl")


def test_pip_installs_what_is_needed_to_make_what_is_missing(
    checkout: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shutil, "which", lambda _: None)
    assert checkout.get_requires_for_build_wheel() == [checkout.NODE, checkout.MKDOCS]

    monkeypatch.setattr(shutil, "which", lambda _: "/usr/bin/npm")
    assert checkout.get_requires_for_build_wheel() == [checkout.MKDOCS]

    for file in (checkout.UPLOT, checkout.SITE):
        file.parent.mkdir(parents=True)
        file.touch()
    assert checkout.get_requires_for_build_wheel() == []
    assert checkout.build_wheel("out") == "the.whl"
    assert not (checkout.TOP / "gateway" / "commit.txt").exists()  # it was there for the build


def test_a_build_without_network_ends_in_one_line_with_the_remedy(checkout: Any) -> None:
    with pytest.raises(SystemExit, match=r"static/vendor cannot be made here: run `make web` where there is"):
        checkout.build_wheel("out")

    checkout.UPLOT.parent.mkdir(parents=True)
    checkout.UPLOT.touch()
    with pytest.raises(SystemExit, match=r"^gateway/docs_site cannot be made here: run `make site` where"):
        checkout.build_wheel("out")


def test_the_site_is_made_by_the_locked_mkdocs_for_which_the_licences_are_shipped(checkout: Any) -> None:
    assert f"\n{checkout.MKDOCS} " in (TOP / "requirements.lock").read_text("utf-8")
