"""Builds the Debian packages: `python -m deploy.deb.build [--distribution NAME] ..`.

Each package holds the program with all that it needs but Python, from the wheels that
deploy/requirements.lock names by their hashes. The same commit gives the same bytes.
"""

from __future__ import annotations

import argparse
import gzip
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

from deploy.deb.changelog import debian_changelog
from deploy.deb.copyright import copyright_of
from deploy.deb.sbom import write_sbom
from deploy.deb.site_manual import site_manual
from deploy.deb.targets import ARCHITECTURES, DISTRIBUTIONS, Distribution, package_version, platforms
from deploy.wheel import TOP, build_wheel, builders_environ, commit_time, project_version

HERE = Path(__file__).parent
LOCK = TOP / "deploy" / "requirements.lock"
OUT = TOP / "dist"
LIBRARY = Path("usr/lib/starter-gateway")
SHARE = Path("usr/share/doc/starter-gateway")


def main() -> int:
    """Build what the arguments name."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--distribution", choices=DISTRIBUTIONS, action="append")
    parser.add_argument("--architecture", choices=ARCHITECTURES, action="append")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="starter-gateway-deb.") as folder:
        wheel = build_wheel(Path(folder) / "wheel")
        for name in args.distribution or DISTRIBUTIONS:
            for architecture in args.architecture or ARCHITECTURES:
                tree = Path(folder) / name / architecture
                lay_out(tree, wheel, DISTRIBUTIONS[name], architecture)
                print(pack(tree, OUT, DISTRIBUTIONS[name], architecture, project_version()))
    return 0


def lay_out(tree: Path, wheel: Path, distribution: Distribution, architecture: str) -> None:
    """Fill `tree` with the files of the package."""
    packages = tree / LIBRARY / "site-packages"
    install_wheels(packages, wheel, distribution, architecture)
    launcher = (HERE / "launcher.py").read_text("utf-8")
    _write(tree / "usr/bin/starter-gateway", launcher, mode=0o755)
    own = launcher.replace("/current", "/site-packages").replace("in force", "installed last")
    _write(tree / LIBRARY / "starter-gateway", own, mode=0o755)
    _copy(HERE / "scripts" / "activate", tree / LIBRARY / "activate", mode=0o755)
    unit = (TOP / "deploy/starter-gateway.service").read_text("utf-8")
    _write(tree / "usr/lib/systemd/system/starter-gateway.service", packaged_unit(unit))
    _copy(HERE / "starter-gateway.sysusers", tree / "usr/lib/sysusers.d/starter-gateway.conf")
    rules = "99-starter-gateway.rules"
    _copy(TOP / "deploy/udev" / rules, tree / "usr/lib/udev/rules.d" / rules)
    completion = _output("register-python-argcomplete", "starter-gateway")
    _write(tree / "usr/share/bash-completion/completions/starter-gateway", completion)
    _copy(HERE / "lintian-overrides", tree / "usr/share/lintian/overrides/starter-gateway")
    manual = _output("argparse-manpage", *_MANUAL) + (HERE / "manual-end.man").read_text("utf-8")
    _write_gzip(tree / "usr/share/man/man1/starter-gateway.1.gz", manual)
    _write_gzip(tree / "usr/share/man/man5/site.toml.5.gz", site_manual())
    _write_gzip(tree / SHARE / "changelog.Debian.gz", debian_changelog(TOP, distribution))
    _write(tree / SHARE / "copyright", copyright_of(packages))
    write_sbom(packages, tree / SHARE / "sbom.cdx.json")
    for example in sorted((TOP / "config").glob("*.toml")):
        _copy(example, tree / SHARE / "examples" / example.name)
    _link(tree / SHARE / "deploy", packages / "gateway/deploy_kit")
    _link(tree / SHARE / "html", packages / "gateway/docs_site")


def install_wheels(packages: Path, wheel: Path, distribution: Distribution, architecture: str) -> None:
    """Install our wheel and the locked ones for a target into a folder; nothing of the target is run."""
    digest = hashlib.sha256(wheel.read_bytes()).hexdigest()
    with tempfile.TemporaryDirectory() as folder:
        wanted = Path(folder) / "requirements.txt"
        own = f"starter-gateway=={project_version()} --hash=sha256:{digest}\n"
        wanted.write_text(own + LOCK.read_text("utf-8"), "utf-8")
        _run(
            *(sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"),
            *("--no-deps", "--no-compile", "--require-hashes", "--only-binary", ":all:"),
            *("--implementation", "cp", "--python-version", distribution.python),
            *(word for each in platforms(architecture) for word in ("--platform", each)),
            *("--find-links", str(wheel.parent), "--target", str(packages), "--requirement", str(wanted)),
        )
    shutil.rmtree(packages / "bin", ignore_errors=True)  # scripts with the path of the builder's Python
    for record in packages.glob("*.dist-info/RECORD"):
        rows = record.read_text("utf-8").splitlines(keepends=True)
        record.write_text("".join(row for row in rows if not row.startswith("../../bin/")), "utf-8")


def packaged_unit(unit: str) -> str:
    """Return the unit as the package has it: the same, with the program's path."""
    head, mark, rest = unit.partition("[Unit]\n")
    assert head.startswith("#")
    changed = rest.replace("/opt/starter-gateway/bin/starter-gateway ", "/usr/bin/starter-gateway ")
    assert changed != rest
    return f"# Starter Gateway as a service. Site settings: systemctl edit starter-gateway\n\n{mark}{changed}"


def pack(tree: Path, out: Path, distribution: Distribution, architecture: str, version: str) -> Path:
    """Write the package of a tree; return its path. Times and modes are the same for every builder."""
    _equalize(tree, commit_time())
    out.mkdir(parents=True, exist_ok=True)
    full = package_version(version, distribution)
    path = out / f"starter-gateway_{full}_{architecture}.deb"
    urls = tomllib.loads((TOP / "pyproject.toml").read_text("utf-8"))["project"]["urls"]
    environ = {
        "ARCH": architecture,
        "VERSION": full,
        "PYTHON": distribution.python,
        "NEXT_PYTHON": f"{distribution.next_python}~~",
        "TREE": str(tree),
        "HOMEPAGE": urls["Homepage"],
        "REPOSITORY": urls["Repository"],
    }
    text = (HERE / "nfpm.yaml").read_text("utf-8")
    for key, value in environ.items():
        text = text.replace(f"${{{key}}}", value)
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder) / "nfpm.yaml"
        config.write_text(text, "utf-8")
        _run(
            "nfpm", "package", "--config", str(config), "--packager", "deb", "--target", str(path), quiet=True
        )
    path.chmod(0o644)  # apt reads it as another user
    return path


_MANUAL = (
    *("--module", "gateway.cli.main", "--function", "whole_parser", "--prog", "starter-gateway"),
    *("--description", "gateway between motor soft-starters on RS-485 and MQTT"),
    *("--project-name", "starter-gateway", "--manual-title", "Starter Gateway", "--manual-section", "1"),
    *("--format", "single-commands-section", "--author", "the maintainers of Starter Gateway"),
)


def _equalize(tree: Path, epoch: int) -> None:
    for path in sorted(tree.rglob("*"), reverse=True):
        if not path.is_symlink():
            path.chmod(0o755 if path.is_dir() or _is_program(path) else 0o644)
        os.utime(path, (epoch, epoch), follow_symlinks=False)


def _is_program(path: Path) -> bool:
    """Return whether a file is run; modules of wheels are not, whatever their modes."""
    with path.open("rb") as file:
        return bool(path.stat().st_mode & 0o100) and path.suffix != ".py" and file.read(2) == b"#!"


def _program(name: str) -> str:
    beside = Path(sys.executable).parent / name
    return str(beside) if beside.exists() else name


def _run(name: str, *arguments: str, quiet: bool = False) -> None:
    output = subprocess.DEVNULL if quiet else None
    subprocess.run([_program(name), *arguments], check=True, cwd=TOP, env=builders_environ(), stdout=output)


def _output(name: str, *arguments: str) -> str:
    command = [_program(name), *arguments]
    done = subprocess.run(
        command, check=True, cwd=TOP, env=builders_environ(), stdout=subprocess.PIPE, encoding="utf-8"
    )
    return done.stdout


def _write(path: Path, text: str, *, mode: int = 0o644) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, "utf-8")
    path.chmod(mode)


def _write_gzip(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(gzip.compress(text.encode(), 9, mtime=0))


def _copy(source: Path, path: Path, *, mode: int = 0o644) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(source, path)
    path.chmod(mode)


def _link(path: Path, to: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.symlink_to(os.path.relpath(to, path.parent))


if __name__ == "__main__":
    sys.exit(main())
