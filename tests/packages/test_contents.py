"""What is in a package: the locked wheels, whole; the same bytes each time; no error of lintian."""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
import os
import re
import shutil
import stat
import subprocess
from importlib.metadata import distributions
from pathlib import Path

import pytest

from deploy.deb.build import LIBRARY, LOCK, SHARE, lay_out, pack
from deploy.deb.targets import ARCHITECTURES, DISTRIBUTIONS
from deploy.libraries import libraries
from deploy.wheel import TOP, build_wheel, project_version
from tests.packages.built import Packages
from tests.reference.configuration_page import tables

MACHINES = {"amd64": 62, "arm64": 183, "armhf": 40}  # e_machine of ELF
PACKAGES = LIBRARY / "site-packages"


@pytest.fixture(scope="module")
def tree(packages: Packages) -> Path:
    return packages.tree("deb12", "amd64")


def locked() -> dict[str, str]:
    """Return the version of each locked package."""
    found = re.findall(r"^([\w.-]+)==(\S+)", LOCK.read_text("utf-8"), re.MULTILINE)
    return {canonical(name): version for name, version in found}


def canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


@pytest.mark.parametrize("lock", ["requirements.lock", "demo.lock"])
def test_a_lock_for_users_is_part_of_the_lock_of_all(lock: str) -> None:
    whole = (TOP / "requirements.lock").read_text("utf-8")
    text = (TOP / "deploy" / lock).read_text("utf-8")
    blocks = re.findall(r"^[\w.-]+==.*(?:\n    --hash=.*)*", text, re.MULTILINE)

    assert blocks
    assert {block.split("==")[0] for block in blocks if block not in whole} <= {
        "argcomplete"
    }  # which no test needs


def test_a_package_has_the_locked_wheels_and_what_they_need(tree: Path) -> None:
    found = {canonical(each.name): each.version for each in distributions(path=[str(tree / PACKAGES)])}

    assert found == {**locked(), "starter-gateway": project_version()}


def test_every_file_of_the_wheels_is_as_they_were_published(tree: Path) -> None:
    wrong = []
    for wheel in distributions(path=[str(tree / PACKAGES)]):
        for path in wheel.files or ():
            if path.hash is not None:
                digest = hashlib.new(path.hash.mode, Path(str(path.locate())).read_bytes()).digest()
                if base64.urlsafe_b64encode(digest).rstrip(b"=").decode() != path.hash.value:
                    wrong.append(str(path))

    assert wrong == []


def test_the_same_commit_gives_the_same_bytes_for_every_builder(
    packages: Packages, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = DISTRIBUTIONS["deb12"]
    first = packages.package("deb12", project_version())
    for name, value in {"COLUMNS": "200", "TZ": "Asia/Kolkata", "LC_ALL": "C", "PYTHONHASHSEED": "7"}.items():
        monkeypatch.setenv(name, value)
    before = os.umask(0o077)
    try:
        again = tmp_path / "another place"
        wheel = build_wheel(tmp_path / "wheel")
        lay_out(again, wheel, target, "amd64")
        second = pack(again, tmp_path / "out", target, "amd64", project_version())
    finally:
        os.umask(before)

    assert packages.wheel().read_bytes() == wheel.read_bytes()
    assert first.name == second.name
    assert first.read_bytes() == second.read_bytes()
    assert stat.S_IMODE(second.stat().st_mode) == 0o644  # apt reads it as another user


LIBRARIES = {"libgcc_s.so.1": "libgcc-s1", "libstdc++.so.6": "libstdc++6"}  # all others: libc6
_NEEDED = re.compile(rb"\0((?:lib[\w+-]+|ld-linux[\w-]*)\.so\.\d+)(?=\0)")


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
@pytest.mark.parametrize("architecture", ARCHITECTURES)
def test_compiled_modules_are_of_the_architecture_and_of_the_distributions_python_and_find_their_libraries(
    distribution: str, architecture: str, packages: Packages
) -> None:
    modules = list(packages.tree(distribution, architecture).rglob("*.so"))
    python = DISTRIBUTIONS[distribution].python.replace(".", "")
    assert [path for path in modules if f"cpython-{python}-" in path.name]
    assert [path for path in modules if not re.search(rf"cpython-{python}-|\.abi3\.", path.name)] == []
    assert {int.from_bytes(path.read_bytes()[18:20], "little") for path in modules} == {
        MACHINES[architecture]
    }
    libraries = {name.decode() for path in modules for name in _NEEDED.findall(path.read_bytes())}
    needed = {LIBRARIES.get(name, "libc6") for name in libraries}
    assert {"libc6", "libgcc-s1"} <= needed <= set(depends())


def depends() -> list[str]:
    """Return the packages that ours depends on."""
    text = (TOP / "deploy" / "deb" / "nfpm.yaml").read_text("utf-8")
    return re.findall(r"^  - ([\w+.-]+)", text.partition("depends:")[2].partition("suggests:")[0], re.M)


def test_the_bill_of_materials_and_the_copyright_name_every_part(tree: Path) -> None:
    bill = json.loads((tree / SHARE / "sbom.cdx.json").read_text("utf-8"))
    rights = (tree / SHARE / "copyright").read_text("utf-8")

    scripts = {each.name: each.version for each in libraries(tree / PACKAGES)}
    named = {canonical(each["name"]): each.get("version") for each in bill["components"]}
    assert bill["bomFormat"] == "CycloneDX"
    assert named == {**locked(), **scripts, "starter-gateway": project_version()}
    assert {"uplot", "lunr", "rxjs", "mkdocs-material"} <= scripts.keys()
    licences = {canonical(label) for label in re.findall(r"^License: (\S+)$", rights, re.MULTILINE)}
    assert {canonical(f"{name}-{version}") for name, version in locked().items()} <= licences
    assert {
        canonical(f"{name}-{version}" if version else name) for name, version in scripts.items()
    } <= licences
    assert "Leon Sorokin" in rights  # who wrote uPlot


def test_the_manual_pages_and_the_documentation_are_there(tree: Path) -> None:
    command, configuration = (
        gzip.decompress((tree / "usr/share/man" / name).read_bytes()).decode()
        for name in ("man1/starter-gateway.1.gz", "man5/site.toml.5.gz")
    )

    assert [
        each for each in ("run", "check", "send", "doctor") if f"starter\\-gateway {each}" not in command
    ] == []
    for table in tables():
        assert f".SH {table.header}\n" in configuration or not table.keys
        assert [key.name for key in table.keys if f"\\fB{key.name}\\fR (" not in configuration] == []
    assert (tree / SHARE / "html" / "NOTICES.txt").exists()
    assert (tree / SHARE / "deploy" / "starter-gateway-bridge.service").exists()


@pytest.mark.skipif(shutil.which("lintian") is None, reason="lintian is not here")
@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
@pytest.mark.parametrize("architecture", ARCHITECTURES)
def test_lintian_finds_no_error(distribution: str, architecture: str, packages: Packages) -> None:
    package = packages.package(distribution, project_version(), None, architecture)

    done = subprocess.run(
        ["lintian", "--allow-root", "--tag-display-limit", "0", "--fail-on", "error", package],
        capture_output=True,
        text=True,
        check=False,
    )

    assert done.returncode == 0, done.stdout + done.stderr
    assert "E: " not in done.stdout
