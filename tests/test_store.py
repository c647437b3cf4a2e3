"""The store on real files: what is kept, what is put aside, and what never prevents anything."""

from __future__ import annotations

import random
import sqlite3
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import TypeVar

import pytest

from gateway.database import MOST_ASIDE, Connection
from gateway.errors import DamagedError, StoreError
from gateway.store import News, Store

T = TypeVar("T")

PATIENCE_S = 10.0
INSERT = "INSERT INTO thing (text) VALUES (?)"


class Things:
    """A table of texts."""

    def create(self, connection: Connection) -> None:
        connection.execute(
            "CREATE TABLE IF NOT EXISTS thing (number INTEGER PRIMARY KEY, text TEXT NOT NULL)"
        )
        connection.execute("SELECT number, text FROM thing LIMIT 1")

    def make_room(self, connection: Connection) -> None:
        connection.execute("DELETE FROM thing WHERE number IN (SELECT number FROM thing LIMIT 20)")


def insert(text: str) -> Callable[[Connection], None]:
    def work(connection: Connection) -> None:
        connection.execute(INSERT, (text,))

    return work


def texts(connection: Connection) -> list[str]:
    return [text for (text,) in connection.execute("SELECT text FROM thing ORDER BY number")]


class Keeping:
    """A store with its news, until `close`."""

    def __init__(self, path: Path, *, max_bytes: int = 2**20) -> None:
        self.news: list[tuple[News, str]] = []
        self._changed = threading.Condition()
        self.store = Store(path, [Things()], on_news=self._hear, max_bytes=max_bytes, retry_s=0.02)
        self.store.start()

    def do(self, work: Callable[[Connection], T]) -> T:
        return self.store.submit(work).result(PATIENCE_S)

    def until(self, news: News) -> str:
        """Wait until this was told, and return the text."""
        with self._changed:
            assert self._changed.wait_for(lambda: news in self.kinds(), PATIENCE_S), self.news
        return next(text for kind, text in self.news if kind is news)

    def kinds(self) -> list[News]:
        return [kind for kind, _ in self.news]

    def close(self) -> None:
        assert self.store.close(within_s=PATIENCE_S)

    def _hear(self, news: News, text: str) -> None:
        with self._changed:
            self.news.append((news, text))
            self._changed.notify_all()


@pytest.fixture
def keeping(tmp_path: Path) -> Iterator[Callable[..., Keeping]]:
    open_: list[Keeping] = []

    def make(path: Path | None = None, **options: int) -> Keeping:
        open_.append(Keeping(path or tmp_path / "state" / "x.sqlite", **options))
        return open_[-1]

    yield make
    for one in open_:
        one.store.close(within_s=PATIENCE_S)


Make = Callable[..., Keeping]


def test_what_was_kept_is_there_after_a_restart(keeping: Make) -> None:
    first = keeping()
    first.do(insert("a"))
    first.close()

    second = keeping()

    assert second.do(texts) == ["a"]
    assert second.kinds() == [News.OPEN]
    assert second.store.lost_s is None
    assert second.store.trouble == ""


def test_work_is_done_in_the_order_in_which_it_was_submitted(keeping: Make) -> None:
    one = keeping()
    for number in range(2000):
        one.store.submit(insert(str(number)))

    assert one.do(texts) == [str(number) for number in range(2000)]


def test_what_was_submitted_before_the_end_is_still_done(keeping: Make) -> None:
    first = keeping()
    for number in range(700):
        first.store.submit(insert(str(number)))
    first.close()

    assert len(keeping().do(texts)) == 700


def test_before_it_is_open_there_is_trouble(tmp_path: Path) -> None:
    store = Store(tmp_path / "x", [Things()], on_news=lambda news, text: None)

    assert store.trouble == "it is not open yet"
    assert store.close(within_s=0.0)


def test_a_closed_store_takes_nothing(keeping: Make) -> None:
    one = keeping()
    one.close()

    with pytest.raises(StoreError, match="closed"):
        one.do(insert("late"))


def test_a_bug_in_one_piece_of_work_spoils_no_other(keeping: Make, caplog: pytest.LogCaptureFixture) -> None:
    one = keeping()
    gate = threading.Event()
    one.store.submit(lambda connection: gate.wait(PATIENCE_S))
    pieces = [one.store.submit(work) for work in (insert("a"), lambda connection: 1 / 0, insert("b"))]
    bad_sql = one.store.submit(lambda connection: connection.execute("SELECT nonsense"))
    gate.set()

    for piece in (pieces[1], bad_sql):
        with pytest.raises(StoreError, match="inside the gateway"):
            piece.result(PATIENCE_S)
    assert one.do(texts) == ["a", "b"]
    assert one.kinds() == [News.OPEN]
    assert len(caplog.records) == 2


def test_work_that_is_no_longer_wanted_is_not_done(keeping: Make) -> None:
    one = keeping()
    gate = threading.Event()
    one.store.submit(lambda connection: gate.wait(PATIENCE_S))
    unwanted: Future[None] = one.store.submit(insert("a"))
    assert unwanted.cancel()
    gate.set()

    assert one.do(texts) == []


def test_only_so_much_waits(keeping: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.store.MOST_WAITING", 2)
    one = keeping()
    one.until(News.OPEN)
    gate, busy = threading.Event(), threading.Event()

    def hold(connection: Connection) -> None:
        busy.set()
        gate.wait(PATIENCE_S)

    one.store.submit(hold)
    assert busy.wait(PATIENCE_S)
    pieces = [one.store.submit(insert(str(number))) for number in range(3)]
    gate.set()

    with pytest.raises(StoreError, match="too much is waiting"):
        pieces[2].result(PATIENCE_S)
    assert pieces[1].result(PATIENCE_S) is None


def test_a_disk_that_does_not_answer_counts_as_away(keeping: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.store.HANG_S", 0.0)
    one = keeping()
    one.until(News.OPEN)
    gate, busy = threading.Event(), threading.Event()

    def hold(connection: Connection) -> None:
        busy.set()
        gate.wait(PATIENCE_S)

    held = one.store.submit(hold)
    assert busy.wait(PATIENCE_S)

    assert "has not answered" in one.store.trouble

    gate.set()
    held.result(PATIENCE_S)


def test_a_file_that_has_reached_its_bound_loses_its_oldest_rows_first(keeping: Make) -> None:
    one = keeping(max_bytes=40 * 4096)
    for number in range(500):
        one.do(insert(f"{number} {'x' * 900}"))

    kept = [int(text.split()[0]) for text in one.do(texts)]
    assert kept[-1] == 499
    assert 50 < len(kept) < 200
    assert kept == list(range(kept[0], 500))
    assert one.kinds() == [News.OPEN]


def test_what_can_never_fit_is_refused_and_the_rest_goes_on(keeping: Make) -> None:
    one = keeping(max_bytes=40 * 4096)

    with pytest.raises(StoreError, match="full"):
        one.do(insert("x" * 2**20))

    assert "full" in one.until(News.AWAY)
    one.store.submit(insert("a"))  # it may be too soon for this one
    while one.store.trouble:
        assert one.kinds().count(News.OPEN) <= 2
    one.do(insert("b"))
    assert one.do(texts)[-1] == "b"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A file with 200 rows that was closed in order."""
    path = tmp_path / "x.sqlite"
    one = Keeping(path)
    for number in range(200):
        one.do(insert(f"{number} {'x' * 100}"))
    one.close()
    return path


def test_a_foreign_file_is_put_aside_and_kept(keeping: Make, path: Path) -> None:
    path.write_text("Dear diary, " * 1000)

    one = keeping(path)

    assert one.do(texts) == []
    assert one.kinds() == [News.LOST, News.OPEN]
    (aside,) = path.parent.glob("*.aside-*")
    assert aside.read_text().startswith("Dear diary")
    assert aside.name in one.news[0][1]
    assert one.store.lost_s is not None


def test_that_a_file_was_lost_is_still_known_after_a_restart(keeping: Make, path: Path) -> None:
    path.write_text("Dear diary, " * 1000)
    first = keeping(path)
    first.until(News.OPEN)
    lost_s = first.store.lost_s
    first.close()

    second = keeping(path)
    second.until(News.OPEN)

    assert second.store.lost_s == lost_s is not None


@pytest.mark.parametrize(
    "sql",
    [
        "PRAGMA application_id = 7",
        "PRAGMA user_version = 99",
        "DROP TABLE thing",
        "ALTER TABLE thing RENAME COLUMN text TO other",
        "DELETE FROM sqlite_master WHERE name = 'thing'",
    ],
)
def test_a_database_of_another_shape_is_put_aside_or_mended(keeping: Make, path: Path, sql: str) -> None:
    connection = sqlite3.connect(path)
    connection.execute("PRAGMA writable_schema = 1")
    connection.execute(sql)
    connection.commit()
    connection.close()

    one = keeping(path)
    one.do(insert("a"))

    assert one.do(texts) == ["a"]


def test_a_folder_of_the_files_name_is_put_aside(keeping: Make, tmp_path: Path) -> None:
    (tmp_path / "x.sqlite" / "inner").mkdir(parents=True)

    one = keeping(tmp_path / "x.sqlite")

    assert one.do(texts) == []
    assert "is no file" in one.until(News.LOST)


def test_an_empty_file_is_a_new_one(keeping: Make, tmp_path: Path) -> None:
    (tmp_path / "x.sqlite").touch()

    one = keeping(tmp_path / "x.sqlite")

    assert one.do(texts) == []
    assert one.kinds() == [News.OPEN]


def test_a_file_spoilt_in_any_way_never_prevents_the_start(keeping: Make, path: Path) -> None:
    dice = random.Random(1)
    whole = path.read_bytes()
    for round_ in range(60):
        spoilt = bytearray(whole)
        match round_ % 4:
            case 0:
                del spoilt[dice.randrange(1, len(spoilt)) :]
            case 1:
                for _ in range(dice.choice((1, 10, 1000))):
                    spoilt[dice.randrange(len(spoilt))] = dice.randrange(256)
            case 2:
                begin = dice.randrange(len(spoilt) - 512)
                spoilt[begin : begin + 512] = bytes(512)
            case 3:
                spoilt[dice.randrange(100)] ^= 1 << dice.randrange(8)
        path.write_bytes(spoilt)
        Path(f"{path}-wal").write_bytes(dice.randbytes(round_ * 100))

        one = keeping(path)
        one.do(insert("a"))
        assert one.do(texts)[-1] == "a"
        one.close()

    assert len(list(path.parent.glob("*.aside-*[0-9]"))) == MOST_ASIDE


def test_damage_that_only_a_reader_sees_is_put_aside_and_he_gets_what_is_new(
    keeping: Make, path: Path
) -> None:
    one = keeping(path)

    def read(connection: Connection) -> list[str]:
        found = texts(connection)
        if found:
            raise DamagedError("these rows make no sense")
        return found

    assert one.do(read) == []
    assert "make no sense" in one.until(News.LOST)


def test_damage_that_stays_is_trouble_and_tried_again(keeping: Make, path: Path) -> None:
    one = keeping(path)

    def read(connection: Connection) -> None:
        raise DamagedError("still no sense")

    with pytest.raises(StoreError, match="still no sense"):
        one.do(read)

    assert "still no sense" in one.until(News.AWAY)
    while one.store.trouble:
        pass
    one.do(insert("a"))


def test_a_file_spoilt_while_it_is_in_use_is_put_aside(keeping: Make, path: Path) -> None:
    one = keeping(path)
    one.do(insert("a"))
    one.do(lambda connection: connection.execute("PRAGMA shrink_memory").fetchall())
    with path.open("r+b") as file:
        file.seek(4096)
        file.write(b"\xff" * 4096 * 8)
    Path(f"{path}-wal").write_bytes(b"")

    def use() -> None:
        one.do(insert("b"))
        one.do(texts)

    for _ in range(5):
        try:
            use()
        except StoreError:
            continue

    one.do(insert("c"))
    assert one.do(texts)[-1] == "c"


def test_a_file_removed_while_it_is_in_use_is_made_anew_and_told(keeping: Make, path: Path) -> None:
    one = keeping(path)
    one.do(insert("a"))
    for entry in path.parent.glob("x.sqlite*"):
        entry.unlink()

    one.do(insert("b"))

    assert one.do(texts) == ["b"]
    assert "removed while in use" in one.until(News.LOST)
    assert one.store.lost_s is not None


def test_a_folder_that_cannot_be_made_is_trouble_until_it_can(keeping: Make, tmp_path: Path) -> None:
    obstacle = tmp_path / "obstacle"
    obstacle.touch()
    one = keeping(obstacle / "x.sqlite")

    text = one.until(News.AWAY)
    with pytest.raises(StoreError):
        one.do(insert("a"))
    obstacle.unlink()
    one.until(News.OPEN)
    one.do(insert("b"))

    assert str(obstacle) in text
    assert one.do(texts) == ["b"]
    assert one.kinds() == [News.AWAY, News.OPEN]
    assert one.store.trouble == ""


def test_a_read_only_file_system_is_trouble_and_told_once(keeping: Make) -> None:
    one = keeping(Path("/proc/starter-gateway/x.sqlite"))

    one.until(News.AWAY)
    for _ in range(3):
        with pytest.raises(StoreError):
            one.do(insert("a"))

    assert one.kinds() == [News.AWAY]
    assert "/proc" in one.store.trouble


def test_a_file_that_another_gateway_has_is_waited_for_not_put_aside(
    keeping: Make, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gateway.database.LOCKED_WITHIN_S", 0.01)
    first = keeping(path)
    first.do(insert("a"))

    second = keeping(path)
    text = second.until(News.AWAY)
    first.close()
    second.until(News.OPEN)

    assert "in use by another process" in text
    assert second.do(texts)[-1] == "a"
    assert not list(path.parent.glob("*.aside-*"))
