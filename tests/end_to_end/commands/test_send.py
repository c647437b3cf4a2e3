"""`send` against a real Mosquitto; the gateway's part is played here, by its own intake and payloads."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from gateway.cli.main import main
from gateway.errors import BrokerError
from gateway.mqtt.connection.settings import BrokerSettings
from gateway.mqtt.contract.commands import Incoming
from gateway.mqtt.contract.freshness import Moment
from gateway.mqtt.contract.payloads import Message, Payloads
from gateway.mqtt.contract.topics import Topics
from gateway.records import Phase, ResultRecord
from gateway.starters.policy.request import CommandRequest
from tests.config.sites import changed
from tests.mosquitto import MosquittoBroker, Seen, StartMosquitto, free_port
from tests.mqtt.commands import TOKEN, UNSYNCHRONISED, intake

TOPICS = Topics("starters/mcc1")
BOOT = "boot-1"
Send = Callable[..., tuple[int, str, str]]


@pytest.fixture
def send(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Send:
    """Give a function that runs `send` with a site whose broker is at a port: exit code, stdout, stderr."""

    def run(port: int, *words: str, changes: tuple[tuple[str, str], ...] = ()) -> tuple[int, str, str]:
        path = tmp_path / "site.toml"
        path.write_text(changed(("mqtts://broker.plant:8883", f"mqtt://127.0.0.1:{port}"), *changes), "utf-8")
        code = main(["send", str(path), *words])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return run


def publish(broker: MosquittoBroker, message: Message) -> None:
    retain = ["-r"] if message.retain else []
    broker.publish(message.topic, message.payload.decode(), *retain)


def be_online(broker: MosquittoBroker, state: str = "online", reason: str | None = None) -> None:
    payloads = Payloads(TOPICS, BOOT)
    publish(broker, payloads.fresh(TOKEN, 1e9))
    publish(broker, payloads.status(state, time_s=1e9, since_s=1e9, reason=reason))


def result(command: CommandRequest, phase: Phase, code: str = "ok", text: str = "", **values: Any) -> Message:
    record = ResultRecord(
        command.starter, command.client, command.id, command.verb, phase, code, text, 1e9, values=values
    )
    return Payloads(TOPICS, BOOT).message(record)


def judged(seen: Seen) -> CommandRequest:
    """Return the command as the gateway understands it; its clock is not to be trusted."""
    verdict = intake(TOPICS).judge(
        Incoming(seen.topic, seen.payload.encode(), is_retained=seen.retain),
        Moment(7.0, 0.0, UNSYNCHRONISED),
    )
    assert isinstance(verdict, CommandRequest)
    return verdict


@pytest.mark.parametrize(
    ("end", "code", "last_line"),
    [
        ((Phase.CONFIRMED, "ok", "the motor runs"), 0, "confirmed: the motor runs\n"),
        ((Phase.REJECTED, "fault_active", "it is in fault"), 1, "rejected [fault_active]: it is in fault\n"),
        ((Phase.UNCONFIRMED, "no_reply", "not seen to act"), 1, "unconfirmed [no_reply]: not seen to act\n"),
        ((Phase.FAILED, "refused", "exception 1"), 1, "failed [refused]: exception 1\n"),
    ],
)
async def test_only_a_confirmed_command_is_done(
    start_mosquitto: StartMosquitto, send: Send, end: tuple[Phase, str, str], code: int, last_line: str
) -> None:
    broker = start_mosquitto()
    be_online(broker)
    async with broker.watch(TOPICS.command_filter) as gateway:
        sending = asyncio.create_task(asyncio.to_thread(send, broker.port, "pump-1", "start"))
        command = judged(await gateway.next())
        stranger = CommandRequest("pump-1", "alice", "start", id="another")

        publish(broker, result(command, Phase.ACCEPTED, text="accepted"))
        publish(broker, result(stranger, Phase.CONFIRMED))
        broker.publish(TOPICS.result("pump-1", "alice"), "no json")
        publish(broker, result(command, Phase.WRITTEN, text="written; being read back"))
        publish(broker, result(command, *end))

        done = await sending
    assert done == (code, f"accepted\nwritten: being read back\n{last_line}", "")
    assert (command.starter, command.client, command.verb) == ("pump-1", "alice", "start")


async def test_a_value_that_was_read_is_shown(start_mosquitto: StartMosquitto, send: Send) -> None:
    broker = start_mosquitto()
    be_online(broker)
    async with broker.watch(TOPICS.command_filter) as gateway:
        words = ("pump-1", "read", "parameter=P003", "--client", "bob")
        sending = asyncio.create_task(asyncio.to_thread(send, broker.port, *words))
        command = judged(await gateway.next())

        publish(broker, result(command, Phase.CONFIRMED, value=12.5, unit="A", label=None))

        done = await sending
    assert done == (0, "confirmed = 12.5 A\n", "")
    assert (command.client, command.args) == ("bob", {"parameter": "P003"})


async def test_several_values_are_shown_each_on_a_line(start_mosquitto: StartMosquitto, send: Send) -> None:
    broker = start_mosquitto()
    be_online(broker)
    async with broker.watch(TOPICS.command_filter) as gateway:
        words = ("pump-1", "read", "parameters=P003,P220", "--client", "bob")
        sending = asyncio.create_task(asyncio.to_thread(send, broker.port, *words))
        command = judged(await gateway.next())
        values = {
            "P003": {"value": 12.5, "unit": "A", "label": None, "raw": [125]},
            "P220": {"value": 0, "unit": "", "label": "Always Local", "raw": [0]},
        }

        publish(broker, result(command, Phase.CONFIRMED, text="read", values=values))

        done = await sending
    assert done == (0, "confirmed: read\n  P003 = 12.5 A\n  P220 = Always Local\n", "")


async def test_every_command_has_an_id_of_its_own_and_leaves_nothing_behind(
    start_mosquitto: StartMosquitto, send: Send
) -> None:
    broker = start_mosquitto()
    be_online(broker)
    bodies = []
    async with broker.watch(TOPICS.command_filter) as gateway:
        for _ in range(2):
            sending = asyncio.create_task(asyncio.to_thread(send, broker.port, "pump-1", "stop"))
            seen = await gateway.next()
            bodies.append(json.loads(seen.payload))
            publish(broker, result(judged(seen), Phase.CONFIRMED))
            await sending

    assert bodies[0]["id"] != bodies[1]["id"]
    assert all(body["boot"] == BOOT and body["issued_at"].endswith("Z") for body in bodies)
    assert not any("token" in body for body in bodies)  # a stop waits for no proof
    async with broker.watch(TOPICS.command_filter, TOPICS.gateway_status) as later:
        assert (await later.next()).topic == TOPICS.gateway_status  # neither a retained command nor a will


def test_without_a_final_result_the_command_has_failed(start_mosquitto: StartMosquitto, send: Send) -> None:
    broker = start_mosquitto()
    be_online(broker)

    code, out, error = send(broker.port, "pump-1", "start", "--timeout", "0.1")

    assert (code, out) == (1, "")
    assert error.startswith("starter-gateway: no final result within 0.1 s: look at the starter")


def test_nothing_is_sent_to_a_gateway_that_is_offline(start_mosquitto: StartMosquitto, send: Send) -> None:
    broker = start_mosquitto()
    be_online(broker, "offline", "ended by SIGTERM")

    code, _, error = send(broker.port, "pump-1", "start")

    assert (code, error) == (1, "starter-gateway: the gateway is offline: ended by SIGTERM (start it)\n")
    assert "command/pump-1" not in broker.log()


def test_a_gateway_that_was_never_there_is_told(
    start_mosquitto: StartMosquitto, send: Send, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gateway.mqtt.connection.command_client.STATUS_WITHIN_S", 0.1)
    broker = start_mosquitto()

    code, _, error = send(broker.port, "pump-1", "start")

    assert code == 1
    assert (
        error
        == f"starter-gateway: no gateway has told its state in {TOPICS.gateway_status} (is it running?)\n"
    )


def test_a_login_without_the_right_to_write_is_told(
    start_mosquitto: StartMosquitto, send: Send, tmp_path: Path
) -> None:
    acl = "user alice\ntopic read starters/#\nuser mcc1\ntopic readwrite starters/#\n"
    broker = start_mosquitto(users={"alice": "a", "mcc1": "m"}, acl=acl)
    payloads = Payloads(TOPICS, BOOT)
    status = payloads.status("online", time_s=1e9, since_s=1e9, reason=None)
    for message in (payloads.fresh(TOKEN, 1e9), status):
        broker.publish(message.topic, message.payload.decode(), "-r", user=("mcc1", "m"))
    (tmp_path / "alice.password").write_text("a\n")
    (tmp_path / "alice.password").chmod(0o600)
    words = ("pump-1", "start", "--username", "alice", "--password-file", str(tmp_path / "alice.password"))

    code, _, error = send(broker.port, *words)

    assert code == 1
    assert f"does not let user alice write {TOPICS.command('pump-1', 'alice', 'start')}" in error


def test_the_configurations_own_login_is_taken_when_no_other_is_given(
    start_mosquitto: StartMosquitto, send: Send, monkeypatch: pytest.MonkeyPatch
) -> None:
    broker = start_mosquitto(users={"mcc1": "m"})
    monkeypatch.setenv("STARTER_GATEWAY_MQTT_PASSWORD", "m")
    monkeypatch.setattr("gateway.mqtt.connection.command_client.STATUS_WITHIN_S", 0.1)

    code, _, error = send(broker.port, "pump-1", "start", changes=(("[mqtt]", '[mqtt]\nusername = "mcc1"'),))

    assert code == 1
    assert "no gateway has told its state" in error  # so it was let in


def test_the_password_of_another_login_is_asked_for_or_taken_from_the_environment(
    send: Send, monkeypatch: pytest.MonkeyPatch
) -> None:
    logins: list[tuple[str | None, str | None]] = []

    def note(settings: BrokerSettings, _: Topics) -> None:
        logins.append((settings.username, settings.password))
        raise BrokerError("enough")

    monkeypatch.setattr("gateway.cli.send.CommandClient", note)
    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    monkeypatch.setattr("getpass.getpass", lambda prompt: f"typed at {prompt!r}")

    send(1, "pump-1", "start", "--username", "alice")
    monkeypatch.setenv("STARTER_GATEWAY_MQTT_PASSWORD", "a")
    send(1, "pump-1", "start", "--username", "alice")
    send(1, "pump-1", "start")

    assert logins == [("alice", "typed at 'Password of alice at 127.0.0.1: '"), ("alice", "a"), (None, "a")]


def test_a_user_without_a_name_makes_no_claim(send: Send, monkeypatch: pytest.MonkeyPatch) -> None:
    def nobody() -> str:
        raise KeyError("uid not found")

    monkeypatch.setattr("getpass.getuser", nobody)

    code, _, error = send(free_port(), "pump-1", "start")

    assert (code, "nothing listens there" in error) == (1, True)


def test_a_broker_that_is_away_is_told_in_one_line(send: Send) -> None:
    code, _, error = send(free_port(), "pump-1", "start")

    assert code == 1
    assert error.count("\n") == 1
    assert "nothing listens there" in error


@pytest.mark.parametrize(
    ("words", "changes", "told"),
    [
        (("pump-9", "start"), (), "no starter 'pump-9' (one of pump-1, pump-2)"),
        (("pump-1", "Start"), (), "no verb 'Start'"),
        (("pump-1", "start", "--client", "A/b"), (), "--client 'A/b' is no name"),
        (("pump-1", "set", "P314"), (), "argument 'P314' is not KEY=VALUE"),
        (("pump-1", "start", "--username", "alice"), (), "no password for alice"),
        (
            ("pump-1", "start"),
            (
                (
                    'starters = ["pump-*"]\n',
                    'starters = ["*"]\n[[operator]]\nclient = "b"\nmay = ["*"]\nstarters = ["*"]\n',
                ),
            ),
            "which operator? (--client with one of alice, b)",
        ),
        (
            ("pump-1", "start"),
            (('[[operator]]\nclient = "alice"\nmay = ["start", "stop"]\nstarters = ["pump-*"]\n', ""),),
            "the configuration has no [[operator]]: the gateway is read-only",
        ),
    ],
)
def test_what_cannot_be_asked_is_told_before_anything_is_sent(
    send: Send, words: tuple[str, ...], changes: tuple[tuple[str, str], ...], told: str
) -> None:
    code, _, error = send(free_port(), *words, changes=changes)

    assert code == 2
    assert told in error


async def test_a_selection_prints_its_token_for_the_command_that_follows(
    start_mosquitto: StartMosquitto, send: Send
) -> None:
    broker = start_mosquitto()
    be_online(broker)
    async with broker.watch(TOPICS.command_filter) as gateway:
        words = ("pump-1", "select", "verb=set", "parameter=P314", "value=30", "--client", "alice")
        sending = asyncio.create_task(asyncio.to_thread(send, broker.port, *words))
        command = judged(await gateway.next())
        selected = {"select": "0123456789012345", "valid_s": 10.0, "state": "ready"}
        publish(broker, result(command, Phase.CONFIRMED, text="selected while ready", **selected))
        done = await sending

        words = ("pump-1", "start", "select=0123456789012345", "expect=state:ready,remote:true")
        sending = asyncio.create_task(asyncio.to_thread(send, broker.port, *words, "--client", "alice"))
        following = judged(await gateway.next())
        publish(broker, result(following, Phase.CONFIRMED))
        await sending

    assert done == (0, "confirmed: selected while ready\nselect=0123456789012345 (within 10.0 s)\n", "")
    assert command.args == {"verb": "set", "args": {"parameter": "P314", "value": 30}}
    assert following.select == "0123456789012345"
    assert following.expect == {"state": "ready", "remote": True}
    assert following.args == {}


async def test_a_group_is_stopped_by_its_name(start_mosquitto: StartMosquitto, send: Send) -> None:
    broker = start_mosquitto()
    be_online(broker)
    group = (
        '[[operator]]\nclient = "alice"',
        '[[group]]\nname = "all"\nstarters = ["*"]\n[[operator]]\nclient = "alice"',
    )
    async with broker.watch(TOPICS.command_filter) as gateway:
        sending = asyncio.create_task(
            asyncio.to_thread(send, broker.port, "all", "stop", "--client", "alice", changes=(group,))
        )
        command = judged(await gateway.next())
        publish(broker, result(command, Phase.CONFIRMED, text="all stand still"))
        done = await sending

    assert (command.starter, command.verb) == ("all", "stop")
    assert done == (0, "confirmed: all stand still\n", "")


@pytest.mark.parametrize("seconds", ["0", "-1", "nan"])
async def test_without_time_for_a_result_nothing_is_sent(
    seconds: str, start_mosquitto: StartMosquitto, send: Send
) -> None:
    broker = start_mosquitto()
    be_online(broker)
    async with broker.watch(TOPICS.command_filter) as gateway:
        code, _, said = await asyncio.to_thread(
            send, broker.port, "pump-1", "start", "--client", "alice", f"--timeout={seconds}"
        )
        broker.publish(TOPICS.command("pump-1", "alice", "stop"), "")

        assert (await gateway.next()).topic == TOPICS.command("pump-1", "alice", "stop")
    assert code == 2
    assert "nothing was sent" in said


@pytest.mark.parametrize("expect", ["ready", "state:", "state:ready,state:running", ":x", ""])
def test_an_expectation_that_cannot_be_read_is_a_usage_error(expect: str, send: Send) -> None:
    code, _, said = send(1, "pump-1", "start", f"expect={expect}", "--client", "alice")

    assert code == 2
    assert "is not POINT:VALUE" in said
