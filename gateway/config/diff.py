"""What differs between two configurations, so that a reload touches nothing else; pure."""

from __future__ import annotations

from dataclasses import dataclass
from operator import attrgetter
from typing import Any

from gateway.config.schema import Config, LineTable, StarterTable
from gateway.errors import Problem

FIXED = ("gateway.name", "gateway.language", "gateway.state_dir", "mqtt.base")
RESTART = "restart the gateway for that: systemctl restart starter-gateway"


@dataclass(frozen=True, slots=True)
class ConfigChanges:
    """Lines and starters that end and begin; what changes is in both, what stays as it is in neither."""

    lines_gone: tuple[str, ...]
    lines_new: tuple[LineTable, ...]  # with all their starters
    starters_gone: tuple[str, ...]  # with those of the lines that end
    lines_joined: tuple[LineTable, ...]  # they stay open; each with the starters alone that come to it
    paces: tuple[tuple[str, float], ...]  # starters of which only `every_s` is another: they stay
    refresh_s: float  # after which unchanged values are published again

    @property
    def lines_forgotten(self) -> tuple[str, ...]:
        """The lines that are no longer configured under any port."""
        new = {line.name for line in self.lines_new}
        return tuple(name for name in self.lines_gone if name not in new)

    def to_dict(self) -> dict[str, Any]:
        """Return the names for people, without what there is none of."""
        came = [each.name for line in (*self.lines_new, *self.lines_joined) for each in line.starters]
        lines_new = [line.name for line in self.lines_new]
        named = {
            "lines_added": [name for name in lines_new if name not in self.lines_gone],
            "lines_reopened": [name for name in lines_new if name in self.lines_gone],
            "lines_removed": list(self.lines_forgotten),
            "starters_added": [name for name in came if name not in self.starters_gone],
            "starters_changed": [name for name in came if name in self.starters_gone],
            "starters_removed": [name for name in self.starters_gone if name not in came],
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
    before, after = _machines(old), _machines(new)
    same = {name for name, machine in before.items() if after.get(name) == machine}
    ports_before, ports_after = ([_port(line) for line in config.lines] for config in (old, new))
    staying = [line for line in new.lines if _port(line) in ports_before]
    came = [tuple(each for each in line.starters if each.name not in same) for line in staying]
    every_s = {each.name: each.every_s for each in old.starters}
    return ConfigChanges(
        lines_gone=tuple(line.name for line in old.lines if _port(line) not in ports_after),
        lines_new=tuple(line for line in new.lines if line not in staying),
        starters_gone=tuple(name for name in before if name not in same),
        lines_joined=tuple(
            line.model_copy(update={"starters": starters})
            for line, starters in zip(staying, came, strict=True)
            if starters
        ),
        paces=tuple(
            (each.name, each.every_s)
            for each in new.starters
            if each.name in same and each.every_s != every_s[each.name]
        ),
        refresh_s=new.mqtt.refresh_s,
    )


def _machines(config: Config) -> dict[str, tuple[LineTable, StarterTable]]:
    """Return by starter what it is and where: another one ends and begins."""
    return {each.name: (_port(line), _machine(each)) for line in config.lines for each in line.starters}


def _port(line: LineTable) -> LineTable:
    """Return a line without its title, its starters, their order and points: another one is restarted."""
    return line.model_copy(update={"title": None, "starters": (), "order": None, "points": ()})


def _machine(starter: StarterTable) -> StarterTable:
    """Return a starter without what does not concern its polls (rules, simulation), or only their pace.

    The points and rows that the configuration adds stay, wherever they are asked for.
    """
    others = {"rules": None, "simulated": None, "every_s": 1.0, "points": ()}
    return starter.model_copy(update=others)
