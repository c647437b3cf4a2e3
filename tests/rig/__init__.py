"""The rig of five doors: a whole gateway in virtual time, and tables of scenarios. README.md says how.

TOML goes in (`RigPlant`, pieces in `tests.rig.sites`), words on a simulated line (`RigLine`), messages at a
broker in memory (`Broker`), requests at the page (`WebBrowser`), commands (`run_cli`).
"""

from tests.rig.broker import Broker, MqttMessage, RigClient
from tests.rig.line import RigLine, Starter
from tests.rig.plant import Ran, RigPlant, run_cli
from tests.rig.rows import (
    ScenarioRow,
    act,
    apart,
    clean_line,
    command,
    event,
    fault,
    frames,
    msg,
    never,
    play,
    played,
    publish,
    reload,
    result,
    results,
    retained,
    row,
    scene,
    seen,
    that,
)
from tests.rig.web import WebAnswer, WebBrowser

__all__ = [
    "Broker",
    "MqttMessage",
    "Ran",
    "RigClient",
    "RigLine",
    "RigPlant",
    "ScenarioRow",
    "Starter",
    "WebAnswer",
    "WebBrowser",
    "act",
    "apart",
    "clean_line",
    "command",
    "event",
    "fault",
    "frames",
    "msg",
    "never",
    "play",
    "played",
    "publish",
    "reload",
    "result",
    "results",
    "retained",
    "row",
    "run_cli",
    "scene",
    "seen",
    "that",
]
