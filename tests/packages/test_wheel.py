"""The wheel in a fresh environment, as pip and pipx install it: documentation, page, deploy kit."""

from __future__ import annotations

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from deploy.wheel import TOP, project_version
from tests.packages.built import Packages

WITHIN_S = 240.0


@pytest.fixture(scope="module")
def program(packages: Packages, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the program of a fresh environment that has the wheel, with the extra `web`."""
    venv = tmp_path_factory.mktemp("wheel") / "venv"
    pip = (venv / "bin/python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check")
    subprocess.run([sys.executable, "-m", "venv", venv], check=True, timeout=WITHIN_S)
    subprocess.run([*pip, f"{packages.wheel()}[web]"], check=True, timeout=WITHIN_S)
    return venv / "bin" / "starter-gateway"


def output_of(program: Path, *arguments: str | Path, folder: Path) -> str:
    done = subprocess.run(
        [program, *arguments], cwd=folder, capture_output=True, text=True, check=False, timeout=60.0
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_wheel_holds_the_documentation_the_page_and_the_deploy_kit_and_no_leftovers(
    packages: Packages,
) -> None:
    names = zipfile.ZipFile(packages.wheel()).namelist()

    for wanted in (
        "gateway/docs_site/index.html",
        "gateway/docs_site/NOTICES.txt",
        "gateway/plugins/web/static/index.html",
        "gateway/plugins/web/static/vendor/uPlot.iife.min.js",
        "gateway/deploy_kit/INSTALL.md",
        "gateway/deploy_kit/starter-gateway.service",
        "gateway/deploy_kit/starter-gateway-bridge.service",
        "gateway/deploy_kit/udev/99-starter-gateway.rules",
        "gateway/deploy_kit/config/plant.toml",
    ):
        assert wanted in names
    assert [name for name in names if name.split("/")[0] not in ("gateway", dist_info())] == []
    assert [name for name in names if "__pycache__" in name or "/deploy_kit/deb/" in name] == []


def test_what_pip_builds_from_a_checkout_has_plots_and_documentation(tmp_path: Path) -> None:
    tree, pip = tmp_path / "checkout", (sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps")
    listed = subprocess.run(
        ["git", "-C", TOP, "ls-files", "-z"], check=True, capture_output=True, text=True
    ).stdout.split("\0")
    for name in filter(None, listed):
        (tree / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(TOP / name, tree / name)

    subprocess.run([*pip, "--wheel-dir", tmp_path, tree], check=True, timeout=WITHIN_S)

    (wheel,) = tmp_path.glob("*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    vendor = "gateway/plugins/web/static/vendor"
    for wanted in (f"{vendor}/uPlot.iife.min.js", f"{vendor}/uPlot.min.css", "gateway/docs_site/index.html"):
        assert wanted in names
        assert not (tree / wanted).exists()  # the checkout stays as it was


def dist_info() -> str:
    return f"starter_gateway-{project_version()}.dist-info"


def test_the_installed_wheel_has_its_documentation_and_its_kit(program: Path, tmp_path: Path) -> None:
    assert project_version() in output_of(program, "--version", folder=tmp_path)
    documentation = Path(output_of(program, "docs", "--path", folder=tmp_path).strip())
    kit = Path(output_of(program, "docs", "--deploy", folder=tmp_path).strip())

    assert "Starter Gateway" in (documentation / "index.html").read_text("utf-8")
    assert (kit / "starter-gateway-bridge.service").exists()
    checked = output_of(program, "check", kit / "config" / "pumps.toml", folder=tmp_path)
    assert "valid" in checked
