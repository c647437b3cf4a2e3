"""`backup` and `restore`: what is in a backup, what comes back, and what must not."""

from __future__ import annotations

import gzip
import json
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from gateway.app.site import Site
from gateway.cli.main import main
from gateway.cli.restore.backup import upgrade_site
from gateway.cli.restore.caution import lock_all
from gateway.config.reading import load
from gateway.plugins.sparkplug.numbers import BIRTHS, NUMBER
from gateway.starters.policy.motor_history import LOCKS, MOTORS, MotorHistory
from gateway.starters.policy.write_budget import WRITES
from gateway.store import HISTORY_FILE, STATE_FILE, read_document
from gateway.store.backup import found_versions
from gateway.store.schema import HISTORY, SCHEMAS
from gateway.system.clock import ClockReading
from gateway.system.password_hash import unmatched_line
from tests.cli.backup_site import lock_of, manifest_of, names_in
from tests.rig import run_cli
from tests.rig.sites import PASSWORD_LINE

LATER = HISTORY._replace(steps=(*HISTORY.steps, lambda file: file.execute("CREATE TABLE more (number INT)")))


def test_a_backup_has_configuration_files_and_state_but_no_secret_unless_it_is_asked_for(
    site: Path, backup: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    full = tmp_path / "full.tar.gz"
    assert main(["backup", str(site), str(full), "--secrets"]) == 0
    out = capsys.readouterr().out

    assert names_in(backup)[0] == "manifest.json"
    state = set(SCHEMAS)
    wanted = {"manifest.json", "config/site.toml", f"outside{tmp_path}/ssl/ca.pem"}
    wanted |= {f"state/{name}" for name in state}
    assert set(names_in(backup)) == wanted
    assert set(names_in(full)) == wanted | {"config/secret/mqtt.password"}
    assert b"hunter2" not in gzip.decompress(backup.read_bytes())
    assert PASSWORD_LINE.encode() not in gzip.decompress(backup.read_bytes())
    assert PASSWORD_LINE.encode() in gzip.decompress(full.read_bytes())
    assert {path.stat().st_mode & 0o777 for path in (backup, full)} == {0o600}
    assert "holds passwords and keys" in out
    facts = manifest_of(backup)
    assert facts["state"] == dict.fromkeys(state, 1)
    assert (facts["left_out"], facts["logins"]) == (["secret/mqtt.password"], ["ann"])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["etc", "full.tar.gz", "plant.tar.gz", "ssl"]


def test_a_login_whose_password_cannot_be_found_in_the_text_is_not_stored_by_mistake(
    site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    site.write_text(site.read_text().replace('password = "$', 'password = "\\u0024'))

    assert main(["backup", str(site), str(tmp_path / "plant.tar.gz")]) == 78

    assert "the password of login ann cannot be left out (write it without escapes" in capsys.readouterr().err
    assert not (tmp_path / "plant.tar.gz").exists()


@pytest.mark.parametrize("is_imported", [True, False])
def test_what_comes_back_is_what_was_there_but_locked_and_known_to_be_of_before(
    site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], *, is_imported: bool
) -> None:
    backup = tmp_path / "plant.tar.gz"
    if not is_imported:  # 0.2.0 has just ended
        (site.parent / "state" / STATE_FILE).unlink()
    assert main(["backup", str(site), str(backup)]) == 0
    assert main(["restore", str(backup), "--to", str(tmp_path / "new")]) == 0
    out = capsys.readouterr().out
    new, state = tmp_path / "new", tmp_path / "new" / "state"

    config = load(new / "site.toml")
    assert config.web is not None
    assert config.web.users[0].password == unmatched_line()
    assert (new / "site.toml").stat().st_mode & 0o777 == 0o640
    assert (new / "outside" / str(tmp_path)[1:] / "ssl" / "ca.pem").read_text() == "authority"
    assert read_document(state / STATE_FILE, "writes", WRITES) == {"pump": 1}
    pump, mill = lock_of(state, "pump"), lock_of(state, "mill")
    assert pump is not None
    assert pump["by"] == "gateway"
    assert pump["reason"].startswith("restored from a backup of 20")
    assert mill is not None
    assert mill["reason"] == "bearing"  # its own lock stays
    assert read_document(state / STATE_FILE, BIRTHS, NUMBER) == 2 + 128
    last = run_cli("audit", "show", str(state), "--last", "1", "--json").out
    assert json.loads(last)["code"] == "state_restored"
    assert run_cli("audit", "verify", str(state)).code == 0
    assert "locked until an operator unlocks them: pump\n" in out
    assert "not in the backup, to be given again: secret/mqtt.password, the password of login ann" in out
    assert "put each where it belongs" in out
    assert "others now" not in out


def test_a_restore_elsewhere_names_the_places_that_the_configuration_has_wrong_then(
    site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    state, key = site.parent / "state", site.parent / "secret" / "mqtt.password"
    text = site.read_text().replace('"state"', f'"{state}"').replace('"secret/mqtt.password"', f'"{key}"')
    site.write_text(text)
    assert main(["backup", str(site), str(tmp_path / "plant.tar.gz"), "--secrets"]) == 0

    assert main(["restore", str(tmp_path / "plant.tar.gz"), "--to", str(tmp_path / "new")]) == 0

    assert f"places that are others now: change {key}, {state}\n" in capsys.readouterr().out


def test_starts_stay_as_old_as_they_were_on_a_machine_that_has_run_for_a_year(site: Path) -> None:
    year_s = 365 * 86400.0
    path = site.parent / "state" / STATE_FILE
    before = read_document(path, LOCKS, MOTORS)
    assert before is not None
    age_s = before.at.utc_s - before.starters["pump"].starts[0]
    here = ClockReading(up_s=year_s, utc_s=before.at.utc_s + 60.0, boot_id="another")

    lock_all(site.parent / "state", load(site), here, "restored")

    stored = read_document(path, LOCKS, MOTORS)
    assert stored is not None
    history = MotorHistory()
    history.restore(stored, now_s=1000.0, reading=ClockReading(year_s + 5.0, here.utc_s + 5.0, "another"))
    assert history.starts_since("pump", 0.0) == [pytest.approx(1000.0 - 5.0 - age_s)]


def test_a_file_of_an_earlier_version_is_taken_to_this_one_after_a_backup_that_can_be_restored(
    site: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    state = site.parent / "state"
    monkeypatch.setitem(SCHEMAS, HISTORY_FILE, LATER)

    upgrade_site(site, Site.read(site, {}))
    upgrade_site(site, Site.read(site, {}))  # nothing more to do: the backup stays

    backup = state / "before-upgrade.tar.gz"
    assert manifest_of(backup)["state"] == {STATE_FILE: 1, HISTORY_FILE: 1}
    assert "config/secret/mqtt.password" in names_in(backup)
    assert main(["check", str(site), "--upgrade"]) == 0
    monkeypatch.undo()  # the earlier version again
    assert main(["check", str(site), "--upgrade"]) == 78
    assert "history.sqlite has format 2" in capsys.readouterr().err
    assert main(["restore", str(backup), "--replace"]) == 0
    assert main(["check", str(site), "--upgrade"]) == 0


def test_where_no_backup_can_be_made_the_upgrade_goes_on(
    site: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setitem(SCHEMAS, HISTORY_FILE, LATER)
    known = Site.read(site, {})
    (site.parent / "secret" / "mqtt.password").unlink()

    upgrade_site(site, known)

    assert "no backup before the upgrade" in caplog.text
    assert found_versions(site.parent / "state")[HISTORY_FILE] == 2


def test_a_state_of_a_later_version_is_refused_by_run_and_stays_as_it_is(
    site: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("faulthandler.enable", lambda: None)  # pytest has its own
    monkeypatch.setattr("gateway.cli.run.log_to_stderr", lambda **_: None)
    with closing(sqlite3.connect(site.parent / "state" / STATE_FILE)) as connection:
        connection.execute("PRAGMA user_version = 9")
    before = (site.parent / "state" / STATE_FILE).read_bytes()

    assert main(["run", str(site)]) == 78

    assert "state.sqlite has format 9" in capsys.readouterr().err
    assert (site.parent / "state" / STATE_FILE).read_bytes() == before
