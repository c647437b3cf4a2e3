"""What differs between two configurations, so that a reload touches nothing else; pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

from gateway.config.schema import NOT_SIMULATED, Config, LineTable, StarterTable
from gateway.errors import Problem

FIXED = ("gateway.name", "gateway.language", "gateway.state_dir", "mqtt.base")
RESTART = "restart the gateway for that: systemctl restart starter-gateway"


@dataclass(frozen=True, slots=True)
class Additions:
    """Starters that come to a line which stays open."""

    line: LineTable
    starters: tuple[StarterTable, ...]


@dataclass(frozen=True, slots=True)
class ConfigChanges:
    """Lines and starters that end and begin; what changes is in both, what stays as it is in neither."""

    lines_gone: tuple[str, ...]
    lines_new: tuple[LineTable, ...]  # with all their starters
    starters_gone: tuple[str, ...]  # with those of the lines that end
    starters_new: tuple[Additions, ...]
    paces: tuple[tuple[str, float], ...]  # starters of which only `every_s` is another: they stay
    lines_forgotten: tuple[str, ...]  # no longer configured under any port
    starters_forgotten: tuple[str, ...]
    refresh_s: float | None  # after which unchanged values are published again; None: as before

    def to_dict(self) -> dict[str, Any]:
        """Return the names for people, without what there is none of."""
        came = [each.name for line in self.lines_new for each in line.starters]
        came += [each.name for comers in self.starters_new for each in comers.starters]
        lines_new = [line.name for line in self.lines_new]
        named = {
            "lines_added": [name for name in lines_new if name not in self.lines_gone],
            "lines_reopened": [name for name in lines_new if name in self.lines_gone],
            "lines_removed": list(self.lines_forgotten),
            "starters_added": [name for name in came if name not in self.starters_gone],
            "starters_changed": [name for name in came if name in self.starters_gone],
            "starters_removed": list(self.starters_forgotten),
            "starters_paced": [name for name, _ in self.paces],
        }
        return {key: names for key, names in named.items() if names}


def fixed(old: Config, new: Config) -> list[Problem]:
    """Return which settings cannot change while it runs: name, language, topics and state directory."""
    return [
        Problem(key, f"{before} cannot become {after} while the gateway runs", RESTART)
        for key in FIXED
        if (before := attrgetter(key)(old)) != (after := attrgetter(key)(new))
    ]


def changes_of(old: Config, new: Config) -> ConfigChanges:
    """Return what must be done to lines and starters; the order of tables changes nothing."""
    before = {line.name: line for line in old.lines}
    after = {line.name: line for line in new.lines}
    unchanged = [name for name in after if name in before and _port(before[name]) == _port(after[name])]
    ended = {name: line for name, line in before.items() if name not in unchanged}
    starters_gone = [each.name for line in ended.values() for each in line.starters]
    comers, paces = [], []
    for name in unchanged:
        gone, came, paced = _compared(before[name].starters, after[name].starters)
        starters_gone += gone
        paces += paced
        if came:
            comers.append(Additions(after[name], came))
    still = {each.name for each in new.starters}
    return ConfigChanges(
        lines_gone=tuple(ended),
        lines_new=tuple(line for name, line in after.items() if name not in unchanged),
        starters_gone=tuple(starters_gone),
        starters_new=tuple(comers),
        paces=tuple(paces),
        lines_forgotten=tuple(name for name in before if name not in after),
        starters_forgotten=tuple(each.name for each in old.starters if each.name not in still),
        refresh_s=None if old.mqtt.refresh_s == new.mqtt.refresh_s else new.mqtt.refresh_s,
    )


def _compared(
    old: Sequence[StarterTable], new: Sequence[StarterTable]
) -> tuple[list[str], tuple[StarterTable, ...], list[tuple[str, float]]]:
    """Return the names that end, the tables that begin, and the starters that are only asked otherwise."""
    before, after = {each.name: each for each in old}, {each.name: each for each in new}
    same = {name for name in before.keys() & after.keys() if _machine(before[name]) == _machine(after[name])}
    paces = [(n, after[n].every_s) for n in before if n in same and before[n].every_s != after[n].every_s]
    came = tuple(each for name, each in after.items() if name not in same)
    return [name for name in before if name not in same], came, paces


def _port(line: LineTable) -> LineTable:
    """Return a line without its title, its starters, their order and points: another one is restarted."""
    return line.model_copy(update={"title": None, "starters": (), "order": None, "points": ()})


def _machine(starter: StarterTable) -> StarterTable:
    """Return a starter without what does not concern its polls (rules, simulation), or only their pace.

    The points and rows that the configuration adds stay, wherever they are asked for.
    """
    others = {"rules": None, "simulated": NOT_SIMULATED, "every_s": 1.0, "points": ()}
    return starter.model_copy(update=others)
