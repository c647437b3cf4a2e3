"""The container image, built and run without a registry: its base is a fresh system of Debian's packages."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from deploy.wheel import TOP, project_version
from tests.packages.built import need_built
from tests.packages.container import SYSTEMS, why_not
from tests.rig.sites import ALICE, line, starter, table

pytestmark = [pytest.mark.timeout(600), pytest.mark.root]

CERTIFICATES = Path("/etc/ssl/certs/ca-certificates.crt")
NAME = f"localhost/starter-gateway-test-{os.getpid()}"
# As Docker and Podman run it: its own processes and network, its user, a root that nothing can be written to.
RUN = """
mount --bind "$1" "$1"
mount --options remount,bind,ro "$1"
mount --types proc proc "$1/proc"
mount --rbind /dev "$1/dev"
mount --types tmpfs tmpfs "$1/tmp"
mount --bind "$2/site" "$1/etc/starter-gateway"
mount --bind "$2/state" "$1/var/lib/starter-gateway"
ip link set lo up
exec chroot --userspec=900:900 --groups=20 "$1" env --ignore-environment "PATH=$3" sh -ec "$4"
"""
# A broker and simulated starters beside the image's own command; then an operator and the health check.
INSIDE = """
echo "user $(id -u) $(id -G)"
starter-gateway --version
touch /etc/new /opt/starter-gateway/new 2> /dev/null && echo "wrong: the root can be written to"
command -v pip gcc npm && echo "wrong: it has what only the build needs"
mosquitto -p 1883 > /dev/null 2>&1 &
starter-gateway simulate /etc/starter-gateway/site.toml > /dev/null 2>&1 &
healthy > /dev/null 2>&1 && echo "wrong: healthy before it runs"
{command} 2> /tmp/log & it=$!
soon() {{
    for n in $(seq 300); do "$@" > /dev/null 2>&1 && return; sleep 0.1; done
    cat /tmp/log; exit 1
}}
soon healthy
soon grep -q "pump ready" /tmp/log
starter-gateway send /etc/starter-gateway/site.toml pump start --client alice
kill -TERM $it; code=0; wait $it || code=$?
echo "ended with $code"
"""


def site_text() -> str:
    """Return a configuration with a page; its state is where the image keeps it."""
    return (
        table("gateway", name="plant")
        + table("mqtt", url="mqtt://127.0.0.1:1883")
        + line("hall", port="/tmp/line")
        + starter("pump", 1, "ssw07")
        + table("web")
        + ALICE
    )


def buildah(*arguments: str | Path) -> str:
    command = ["buildah", "--log-level", "error", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=500.0)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
    return done.stdout.strip()


@pytest.fixture(scope="module")
def image(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Build the image on a system of Debian; only packages of Debian and of Python are fetched."""
    if reason := why_not("bookworm"):
        pytest.skip(f"no fresh system of Debian: {reason}")
    if shutil.which("buildah") is None:
        pytest.skip("buildah is not installed")
    need_built()
    base = buildah("from", "scratch")
    buildah("add", "--quiet", base, SYSTEMS / "bookworm.tar", "/")
    buildah("commit", "--quiet", "--rm", base, f"{NAME}-base")
    pip = tmp_path_factory.mktemp("pip") / "pip.conf"
    pip.write_text("[global]\ncert = /host.pem\n", "utf-8")
    mounts = ("--volume", f"{pip}:/etc/pip.conf:ro", "--volume", f"{CERTIFICATES}:/host.pem:ro")
    options = ("--isolation", "chroot", "--network", "host", "--pull-never", "--format", "docker", *mounts)
    file = ("--file", TOP / "deploy/oci/Containerfile")
    buildah("build", *options, "--build-arg", f"BASE={NAME}-base", "--tag", NAME, *file, TOP)
    yield NAME
    buildah("rmi", "--force", NAME, f"{NAME}-base")


def test_the_image_runs_as_its_user_on_a_read_only_root_and_starts_a_motor(
    image: str, tmp_path: Path
) -> None:
    config = json.loads(buildah("inspect", "--type", "image", image))["Docker"]["config"]
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "site.toml").write_text(site_text(), "utf-8")
    (tmp_path / "state").mkdir(mode=0o700)
    os.chown(tmp_path / "state", 900, 900)
    container = buildah("from", "--pull-never", image)
    try:
        root = buildah("mount", container)
        (path,) = [each.removeprefix("PATH=") for each in config["Env"] if each.startswith("PATH=")]
        inside = INSIDE.format(command=" ".join([*config["Entrypoint"], *config["Cmd"]]))
        own = ("unshare", "--mount", "--pid", "--net", "--fork", "--kill-child", "--propagation", "private")
        done = subprocess.run(
            [*own, "bash", "-ec", RUN, "bash", root, tmp_path, path, inside],
            capture_output=True,
            text=True,
            check=False,
            timeout=120.0,
        )
    finally:
        buildah("rm", container)

    said = done.stdout.splitlines()
    assert done.returncode == 0, done.stdout + done.stderr
    assert said[0] == "user 900 900 20"
    assert project_version() in said[1]
    assert [each for each in said if each.startswith("wrong")] == []
    assert [each for each in said if each.startswith("confirmed")]
    assert said[-1] == "ended with 0"
    assert config["User"] == "starter-gateway"
    assert config["Healthcheck"]["Test"] == ["CMD", "healthy"]
