"""`backup` and `restore`: what is in a backup, what comes back, and what must not."""

from __future__ import annotations

import gzip
import json
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from gateway.app.site import Site
from gateway.cli.restore.backup import upgrade_site
from gateway.config.reading import load
from gateway.plugins.sparkplug.numbers import BIRTHS, NUMBER
from gateway.starters import lock_restored
from gateway.starters.policy.motor_history import LOCKS, MOTORS, MotorHistory
from gateway.starters.policy.write_budget import WRITES
from gateway.store import HISTORY_FILE, STATE_FILE, read_document
from gateway.store.backup import found_versions
from gateway.store.schema import HISTORY, SCHEMAS
from gateway.system.clock import ClockReading
from gateway.system.password_hash import unmatched_line
from tests.cli.backup_site import BackupSite, lock_of, manifest_of, names_in
from tests.rig.sites import PASSWORD_LINE

LATER = HISTORY._replace(steps=(*HISTORY.steps, lambda file: file.execute("CREATE TABLE more (number INT)")))
BOTH = "-----BEGIN CERTIFICATE-----\n-----BEGIN EC PRIVATE KEY-----\nhunter3\n"


def test_a_backup_has_configuration_files_and_state_but_no_secret_unless_it_is_asked_for(
    place: BackupSite, backup: Path
) -> None:
    full = place.folder / "full.tar.gz"
    assert "holds passwords and keys" in place.cli("backup SITE DIR/full.tar.gz --secrets").out

    wanted = {"config/site.toml", f"outside{place.folder}/ssl/ca.pem", *(f"state/{name}" for name in SCHEMAS)}
    first, *others = names_in(backup)
    assert (first, set(others)) == ("manifest.json", wanted)
    assert set(names_in(full)) == {first, *wanted, "config/secret/mqtt.password"}
    for secret in (b"hunter2", PASSWORD_LINE.encode()):
        assert [secret in gzip.decompress(path.read_bytes()) for path in (backup, full)] == [False, True]
    assert {path.stat().st_mode & 0o777 for path in (backup, full)} == {0o600}
    facts = manifest_of(backup)
    assert facts["state"] == dict.fromkeys(SCHEMAS, 1)
    assert (facts["left_out"], facts["logins"]) == (["secret/mqtt.password"], ["ann"])
    assert {path.name for path in place.folder.iterdir()} == {"etc", "ssl", full.name, backup.name}


@pytest.mark.parametrize("named", ['cert_file = "both.pem"\nkey_file = "both.pem"\n', ""])
def test_a_key_is_a_secret_whatever_names_it(place: BackupSite, named: str) -> None:
    (place.config.parent / "both.pem").write_text(BOTH)
    place.change("[web]", f"{named}\n[web]")
    place.change("DIR/ssl/ca.pem", "secret/../both.pem")

    for options, is_there in (("", False), ("--secrets", True)):
        place.cli(f"backup SITE DIR/b.tar.gz {options}")
        assert ("config/both.pem" in names_in(place.folder / "b.tar.gz")) is is_there


def test_a_login_whose_password_cannot_be_found_in_the_text_is_not_stored_by_mistake(
    place: BackupSite,
) -> None:
    place.change('password = "$', 'password = "\\u0024')

    said = "the password of login ann cannot be left out (write it without escapes"
    place.cli("backup SITE DIR/plant.tar.gz", 78, err=said)

    assert not (place.folder / "plant.tar.gz").exists()


@pytest.mark.parametrize("is_imported", [True, False])
def test_what_comes_back_is_what_was_there_but_locked_and_known_to_be_of_before(
    place: BackupSite, *, is_imported: bool
) -> None:
    if not is_imported:  # 0.2.0 has just ended
        (place.state / STATE_FILE).unlink()
    place.cli("backup SITE DIR/plant.tar.gz")
    out = place.cli("restore DIR/plant.tar.gz --to DIR/new").out
    new, state = place.folder / "new", place.folder / "new" / "state"

    config = load(new / "site.toml")
    assert config.web is not None
    assert config.web.users[0].password == unmatched_line()
    assert (new / "site.toml").stat().st_mode & 0o777 == 0o640
    assert (new / "outside" / str(place.folder)[1:] / "ssl" / "ca.pem").read_text() == "authority"
    assert read_document(state / STATE_FILE, "writes", WRITES) == {"pump": 1}
    pump = lock_of(state, "pump")
    assert pump["by"] == "gateway"
    assert pump["reason"].startswith("restored from a backup of 20")
    assert lock_of(state, "mill")["reason"] == "bearing"  # its own lock stays
    assert read_document(state / STATE_FILE, BIRTHS, NUMBER) == 2 + 128
    assert json.loads(place.cli(f"audit show {state} --last 1 --json").out)["code"] == "state_restored"
    place.cli(f"audit verify {state}")
    assert "locked until an operator unlocks them: pump\n" in out
    assert "not in the backup, to be given again: secret/mqtt.password, the password of login ann" in out
    assert "put each where it belongs" in out
    assert "others now" not in out


def test_a_restore_elsewhere_names_the_places_that_the_configuration_has_wrong_then(
    place: BackupSite,
) -> None:
    place.change('"state"', '"DIR/etc/state"')
    place.change('"secret/mqtt.password"', '"DIR/etc/secret/mqtt.password"')
    place.cli("backup SITE DIR/plant.tar.gz --secrets")

    said = place.cli("restore DIR/plant.tar.gz --to DIR/new").out

    key = place.config.parent / "secret/mqtt.password"
    assert f"places that are others now: change {key}, {place.state}\n" in said


def test_starts_stay_as_old_as_they_were_on_a_machine_that_has_run_for_a_year(place: BackupSite) -> None:
    path = place.state / STATE_FILE
    before = read_document(path, LOCKS, MOTORS)
    assert before is not None
    age_s = before.at.utc_s - before.starters["pump"].starts[0]
    here = ClockReading(up_s=365 * 86400.0, utc_s=before.at.utc_s + 60.0, boot_id="another")

    lock_restored(path, ["pump"], is_lockable=lambda _: True, reading=here, reason="restored")

    stored = read_document(path, LOCKS, MOTORS)
    assert stored is not None
    later = ClockReading(here.up_s + 5.0, here.utc_s + 5.0, "another")
    history = MotorHistory()
    history.restore(stored, now_s=1000.0, reading=later)
    assert history.starts_since("pump", 0.0) == [pytest.approx(1000.0 - 5.0 - age_s)]


def test_a_file_of_an_earlier_version_is_taken_to_this_one_after_a_backup_that_can_be_restored(
    place: BackupSite, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(SCHEMAS, HISTORY_FILE, LATER)

    upgrade_site(place.config, Site.read(place.config, {}))
    upgrade_site(place.config, Site.read(place.config, {}))  # nothing more to do: the backup stays

    backup = place.state / "before-upgrade.tar.gz"
    assert manifest_of(backup)["state"] == {STATE_FILE: 1, HISTORY_FILE: 1}
    assert "config/secret/mqtt.password" in names_in(backup)
    place.cli("check SITE --upgrade")
    monkeypatch.undo()  # the earlier version again
    place.cli("check SITE --upgrade", 78, err="history.sqlite has format 2")
    place.cli(f"restore {backup} --replace")
    place.cli("check SITE --upgrade")


def test_where_no_backup_can_be_made_the_upgrade_goes_on(
    place: BackupSite, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setitem(SCHEMAS, HISTORY_FILE, LATER)
    known = Site.read(place.config, {})
    shutil.rmtree(place.config.parent / "secret")

    upgrade_site(place.config, known)

    assert "no backup before the upgrade" in caplog.text
    assert found_versions(place.state)[HISTORY_FILE] == 2


def test_a_state_of_a_later_version_is_refused_by_run_and_stays_as_it_is(
    place: BackupSite, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("faulthandler.enable", lambda: None)  # pytest has its own
    monkeypatch.setattr("gateway.cli.run.log_to_stderr", lambda **_: None)
    with closing(sqlite3.connect(place.state / STATE_FILE)) as connection:
        connection.execute("PRAGMA user_version = 9")
    before = (place.state / STATE_FILE).read_bytes()

    place.cli("run SITE", 78, err="state.sqlite has format 9")

    assert (place.state / STATE_FILE).read_bytes() == before
