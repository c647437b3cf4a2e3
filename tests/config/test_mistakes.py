"""Every kind of mistake in a configuration, with the line, the key and the hint that it is reported with.

A row is `OLD => NEW | PROBLEM`: the site with that text replaced; or `TABLES | PROBLEM`: tables behind it.
"""

from __future__ import annotations

import pytest

from gateway.app.capacity import check_watchdogs
from gateway.config.reading import parse
from gateway.errors import ConfigError
from tests.config.sites import SITE, changed
from tests.rig.sites import PASSWORD_LINE as LINE

USER = f'[[web.user]]\nname = "anna"\npassword = "{LINE}"\noperator = "alice"'
ROW = '[[row]]\nfamily = "ssw07"\nname = "ramp"\ntitle = "A ramp"\nparameter = '
MENU = '[[row]]\nfamily = "ssw900"\nname = "x"\ntitle = "X"\nwritable = true\nmin = 0\nmax = 1\nparameter = '
LIMITS = "\nmin = 1\nmax = 9\nwritable = true"
STARTER = '[[line.starter]]\nname = "b"\naddress = 1\nfamily = "ssw07"\n'
MISTAKES = r"""
name = "mcc1" => name = "MCC 1" | line 2: gateway.name: is 'MCC 1' (only a-z, 0-9, _ and -)
name = "mcc1" => name = 7 | line 2: gateway.name: is 7 (must be a text in quotes)
name = "mcc1" => nme = "mcc1" | line 2: gateway.nme: unknown key (did you mean name?)
address = 1\n => address = true\n | line 15: line[0].starter[0].address: is true (must be a whole number)
every_s = 2.0 => every_s = nan | line 22: line[0].starter[1].every_s: is nan (must be a finite number)
every_s = 2.0 => title = "a\u0007" | line 22: line[0].starter[1].title: 'a\x07' cannot be printed (letters
framing = "8E1" => framing = "8E1"\ntitle = "0123456789012345678901234567890123456789012345678901234567890"
    | line 12: line[0].title: is '01234567890123456789012345678901234567890123456789012345... (must have at
every_s = 2.0 => slot = 3 | line 22: line[0].starter[1].slot: is 3 (must be at most 2)
framing = "8E1" => framing = "8E1"\norder = ["pump-2", "pump-1", "pump-2"]
    | line 12: line[0].order: is not a list of all starters of this line (name pump-1, pump-2 once each, as th
["start", "stop"] => [] | line 26: operator[0].may: is empty (name at least one)
["start", "stop"] => "start" | line 26: operator[0].may: is 'start' (must be a list)
["pump-*"] => ["fan*"] | line 27: operator[0].starters[0]: 'fan*' fits no starter
["start", "stop"] => ["start", 3] | line 26: operator[0].may[1]: is 3 (must be 'start', 'reset',
name = "mcc1" => name = "A65" | line 2: gateway.name: is 'aaaaaaaa
[mqtt] => [mqtt]\nusername = "" | line 5: mqtt.username: is empty (leave the key out, or give it a value)
mqtts://broker.plant:8883 => mqtts://broker:99999
    | line 5: mqtt.url: is no broker address (mqtts://host:8883; a login goes into username and
mqtts://broker.plant:8883 => mqtts://bob:secret@broker | line 5: mqtt.url: is no broker address (mqtts://host
[mqtt] => [mqtt]\nbase = "Starters/{gateway}"
    | line 5: mqtt.base: is 'Starters/{gateway}' (only a-z, 0-9, _ and - between slashes, and {gateway})
[mqtt] => [mqtt]\ncert_file = "c.pem"
    | line 5: mqtt.cert_file: needs key_file beside it (a certificate and its key go together)
family = "ssw07" => family = "ssw900"\nwatchdog_s = 0.5
    | line 17: line[0].starter[0].watchdog_s: pump-1: 0.5 s is missed by
[[operator]]\n => [[line]]\nname = "b"\nport = "/b"\nbaud = 9600\nframing = "8N2"\n[[operator]]\n
    | line 24: line[1].starter: is missing (at least one [[line.starter]]
[mqtt]\n => [mqqt]\n | mqtt: is missing (a table [mqtt] is needed)
[homeassistant]\ncommands = true | line 29: homeassistant.commands: needs operator beside it
[homeassistant]\nbirth_topic = "starters/mcc1/command/pump-1/alice/start"
    | line 29: homeassistant.birth_topic: lies among the gateway's own topics
[mqtt] => [homeassistant]\n[mqtt]\nbase = "homeassistant/device/sg_{gateway}"
    | line 4: homeassistant.discovery_prefix: lies among the gateway's own topics (a topic outside 'homeassist
[mqtt] => [homeassistant]\n[mqtt]\nbase = "homeassistant" | line 4: homeassistant.discovery_prefix: lies among
[mqtt] => [homeassistant]\n[mqtt]\nbase = "homeassistant/device" | line 4: homeassistant.discovery_prefix: lie
[homeassistant]\ndiscovery_prefix = "ha"\nbirth_topic = "ha"
    | line 30: homeassistant.birth_topic: lies among discovery's topics (a topic outside 'ha/device')
[homeassistant]\ndiscovery_prefix = "spBv1.0"
    | line 29: homeassistant.discovery_prefix: lies among Sparkplug's topics
[homeassistant]\ndiscovery_prefix = "ha"\nbirth_topic = "ha/device/sg_other/config"
    | line 30: homeassistant.birth_topic: lies among discovery's topics (a topic outside 'ha/device')
[history]\nvalues = ["current", "current_"]
    | line 29: history.values[1]: 'current_' is a point of no starter (did you mean current or
[history]\nvalues = ["xyzzy"]
    | line 29: history.values[0]: 'xyzzy' is a point of no starter (the topics B/starter/+/info list
[metrics] | line 28: metrics: nothing serves them (add a [web] table, whose server answers /metrics
[metrics]\ntextfile = "/var/lib/.prom" | line 29: metrics.textfile: is '/var/lib/.prom' (a file's name
[gateway] => web = 7\n[gateway] | line 1: web: is 7 (must be a table, [web])
[web]\nlisten = "8480" | line 29: web.listen: '8480' is no address with a port
[web]\ntrusted_proxies = ["proxy"] | line 29: web.trusted_proxies[0]: 'proxy' is no address
[web]\nhosts = ["http://x"] | line 29: web.hosts[0]: is 'http://x' (a name or address without port
[web]\n[[web.user]]\nname = "anna"\npassword = "LINE"
    | line 29: web.user[0].operator: is missing (name the client of an [[operator]]: the login has its rights)
[web]\nbase_path = "/a/../b" | line 29: web.base_path: is '/a/../b' (a path such as
[sparkplug]\ngroup = "plant"\nusername = "x" | line 30: sparkplug.username: needs urls beside it
[sparkplug]\ngroup = "plant"\nurls = ["mqtt://x"]
    | line 30: sparkplug.urls[0]: would send passwords and commands unencrypted
[[rules]]\nstarters = ["pump-1"]\ntwo_step = ["stop"] | line 30: rules[0].two_step[0]: is 'stop'
[[rules]]\nstarters = ["pump-1"]\nfeeder = "a"
    | line 14: line[0].starter[0].name: has only one of feeder and stagger_s
name = "pump-2" => name = "pump-1"
    | line 19: line[0].starter[1].name: 'pump-1' is also line[0].starter[0].name (each starter needs its own n
address = 2 => address = 1
    | line 20: line[0].starter[1].address: 1 is also line[0].starter[0].address (each starter on
"ssw07" => "ssw99" | line 16: line[0].starter[0].family: is 'ssw99' (did you mean ssw900 or ssw07?)
"ssw07" => "sst" | line 11: line[0].framing: 8E1 is not for sst (pump-1) (its manual allows 8N2)
19200 => 115200
    | line 10: line[0].baud: 115200 is not for ssw07 (pump-1) (its manual allows 9600, 19200, 38400)
19200\nframing = "8E1"\n\n[[line.starter]]\nname = "pump-1" => 57600\nframing = "8E1"\n\n[[line.starter]]
    | line 10: line[0].baud: 57600 is not for ssw07 (its manual allows 9600
/dev/rs485-pumps => COM3
    | line 9: line[0].port: 'COM3' is no port (such as /dev/serial/by-id/...
/dev/rs485-pumps => socket://moxa:65536 | line 9: line[0].port: 'socket://moxa:65536' is no port (such as
[[operator]] => [[line]]\nname="b"\nport="/dev/rs485-pumps"\nbaud=9600\nframing="8N2"\nSTARTER[[operator]]
    | line 26: line[1].port: '/dev/rs485-pumps' is also line[0].port (put all starters of a port under one [[l
family = "ssw07" => family = "ssw07"\nwatchdog_s = 2.5
    | line 17: line[0].starter[0].watchdog_s: 2.5 is no time of its watchdog: P314 takes at most 0 decimals (
family = "ssw07" => family = "ssw07"\nmodel = "SSW-06 85A"
    | line 17: line[0].starter[0].model: 'SSW-06 85A' is the name of a model of ssw06, not of ssw07 (
family = "ssw07" => family = "ssw07"\nslot = 1
    | line 17: line[0].starter[0].slot: ssw07 has no slots (leave it out)
mqtts://broker.plant:8883 => mqtt://broker.plant
    | line 5: mqtt.url: would send passwords and commands unencrypted (use mqtts://, or allow_plaintext = true
name = "mcc1" =>  | line 1: gateway.name: is missing
name = "mcc1" => name = "mcc1"\nlanguage = "de" | line 3: gateway.language: is 'de' (one of en, es, pt)
family = "ssw900" => family = "ssw900"\nfast_words = true
    | line 22: line[0].starter[1].fast_words: was removed in 0.3.0 (leave it out
["pump-*"] => ["pump-*"]\nfreshness = "boot"
    | line 28: operator[0].freshness: was removed in 0.3.0 (leave it out; the client sends the token
[[group]]\nname = "pump-1"\nstarters = ["pump-1"]
    | line 29: group[0].name: 'pump-1' is also line[0].starter[0].name
[rules]\nstarts_per_hour = 2 | line 28: rules: is not a list of tables (write [[rules]]
[web]\nlisten = "0.0.0.0:8480"
    | line 29: web.listen: would send passwords and commands unencrypted (give cert_file and key_file
[web]\nlisten = "0.0.0.0:8480"\nallow_plaintext = true
    | line 29: web.listen: opens the page to other machines without any login (add a [[web.user]]
[web]\n[[web.user]]\nname = "x"\noperator = "carol"\npassword = "LINE"
    | line 31: web.user[0].operator: 'carol' is no [[operator]]'s client (one of alice)
every_s = 2.0 => points = ["S1.1.1", "S1.1.9"]
    | line 22: line[0].starter[1].points[1]: 'S1.1.9' fits no row of ssw900 (did you mean S1.1.
framing = "8E1" => framing = "8E1"\npoints = ["P220", "C8.1.*", "R41"]
    | line 12: line[0].points[2]: 'R41' fits no row of ssw07 or ssw900
[[points]]\nfamily = "ssw07"\ncodes = ["P200"] | line 30: points[0].codes[0]: P200 of ssw07 cannot be read
[[points]]\nfamily = "ssw07"\ncodes = ["P102"]
    | line 30: points[0].codes[0]: 'P102' fits no row of ssw07 (describe it with a [[row]]; or did you mean P
[[points]]\nfamily = "ssw07"\ncodes = ["P101"]\nstarters = ["pump-1", "*-2"]
    | line 31: points[0].starters[1]: '*-2' fits no ssw07 (such starters are of ssw900)
ROW"P102"\nmin = 1\nwritable = true | line 34: row[0].writable: needs max beside it
ROW"P102"\nmin = 0.25\nmax = 1\nscale = 0.1
    | row[0].min: 0.25 is no multiple of scale (the row has steps of 0.1)
ROW"P102"LIMITS\nscale = 0.5 | line 36: row[0].scale: is 0.5 (one of 1, 0.1, 0.01,
ROW"P102"\nmin = 9\nmax = 1 | line 34: row[0].max: 9 to 1 do not fit u16
ROW"P102"LIMITS\naddress = 7 | line 36: row[0].address: is 7, and not the number of P102
ROW"P102"LIMITS\naddress = 7\nscale = 0.5 | line 37: row[0].scale: is 0.5
ROW"P102"LIMITS\ntype = "u8"\nscale = 0 | line 36: row[0].type: is 'u8' (one of u16
ROW"X102"LIMITS | line 32: row[0].parameter: 'X102' is no parameter of ssw07
ROW"P314"LIMITS | line 32: row[0].parameter: P314 is not to be described: the family's manual desc
ROW"P005"LIMITS | line 32: row[0].parameter: P005 is not to be described: it is read as a point of the family
ROW"P264"LIMITS | line 32: row[0].parameter: P264 is not to be described: an input may command the motor
ROW"P231"LIMITS | line 32: row[0].parameter: P231 is not to be described: it may choose who commands the motor
ROW"P310"LIMITS | line 32: row[0].parameter: P310 is not to be described: it may cut the connection
ROW"P218"LIMITS\ntype = "u32" | line 32: row[0].parameter: P218 is not to be described: it has two registers
ROW"P000"LIMITS | line 32: row[0].parameter: P000 is not to be described: it may command the motor, cut the
ROW"P204"LIMITS | line 32: row[0].parameter: P204 is not to be described: it loads or erases parameters
[[row]]\nfamily = "ssw07"\ntitle = "X"\nparameter = "P102"\nname = "current"
    | line 32: row[0].name: 'current' means something else already
[[row]]\nfamily = "ssw07"\ntitle = "X"\nparameter = "P102"\nname = "p101"
    | line 32: row[0].name: 'p101' means something else already
MENU"C5.3.9"\naddress = 900
    | line 35: row[0].parameter: C5.3.9 is not to be described: its registers are those of
MENU"C5.3.9"\naddress = 1599\ntype = "u32"
    | line 35: row[0].parameter: C5.3.9 is not to be described: its registers may be
MENU"C5.3.9"\naddress = 65535\ntype = "u32" | line 36: row[0].address: 65535 and the next are no registers
MENU"C7.3.2"\naddress = 220
    | line 35: row[0].parameter: C7.3.2 is not to be described: the manual gives it the register
MENU"C5.3.9" | line 35: row[0].parameter: needs address beside it
MENU"C3.9"\naddress = 2000
    | line 35: row[0].parameter: C3.9 is not to be described: it may choose who commands the motor
[[row]]\nfamily = "ssw06"\nname = "x"\ntitle = "X"\nwritable = true\nparameter = "P047"\nmin = 0\nmax = 1
    | row[0].parameter: P047 is not to be described: its scale depends on the model
[[row]]\nfamily = "sst"\nparameter = "R50"\nname = "x"\ntitle = "X"
    | line 29: row[0].family: the manual of sst
ROW"P102"LIMITS\nROW"P102"LIMITS
    | line 40: row[1].parameter: 'P102' is also row[0].parameter (describe each row once)
[sparkplug]\ngroup = "a/b" | line 29: sparkplug.group: is 'a/b' (a topic's level, without
family = "ssw07" => family = "ssw07"\nsimulated.parameters.P314 = 70000
    | line 17: line[0].starter[0].simulated.parameters.P314: is 70000 (must be at most 65535
family = "ssw07" => family = "ssw07"\nsimulated.parameters.P999 = 1
    | line 17: line[0].starter[0].simulated.parameters.P999: ssw07 has no such parameter
"ssw07" => "sst"\nsimulated.parameters.COIL1 = 1
    | line 17: line[0].starter[0].simulated.parameters.COIL1: sst has no such parameter
family = "ssw07" => family = "ssw07"\nsimulated.markers.DI1 = true
    | line 17: line[0].starter[0].simulated.markers: ssw07 has no such option (leave it out)
family = "ssw07" => family = "ssw07"\nsimulated.firmware = "new"
    | line 17: line[0].starter[0].simulated.firmware: is 'new' (two numbers with a point
every_s = 2.0 => simulated.markers = { P1 = true }
    | line 22: line[0].starter[1].simulated.markers.P1: ssw900 has no such marker (write COIL
every_s = 2.0 => simulated.markers = { DI70000 = true }
    | line 22: line[0].starter[1].simulated.markers.DI70000: ss
every_s = 2.0 => simulated.markers.DI7 = 1
    | line 22: line[0].starter[1].simulated.markers.DI7: is 1 (must be true or false
every_s = 2.0 => simulated.braking_s = 3.0
    | line 22: line[0].starter[1].simulated.braking_s: ssw900 has no such option (set C7.4.1
every_s = 2.0 => simulated.motor.load = 1 | line 22: line[0].starter[1].simulated.motor.load: unknown key
every_s = 2.0 => simulated = { motor = { "load" = 1 } } | line 22: line[0].starter[1].simulated.motor.load: u
every_s = 2.0 => model = '''a # \n[web]\n[[line.starter]]\n'''\nslot = 3
    | line 26: line[0].starter[1].slot: is 3 (must be at most 2)
every_s = 2.0 => "points" = [ # [web] = {\n"S1.1.1",\n"S1.1.9"]
    | line 22: line[0].starter[1].points[1]: 'S1.1.9' fits no
"""
RIGHT = r"""
ROW"P102"LIMITS\nscale = 0.1\nunit = "s"\nwhile = "always"
ROW"P102"\n[[points]]\nfamily = "ssw07"\ncodes = ["p102", "P1*"]
ROW"P101"LIMITS
MENU"C5.3.9"\naddress = 2000\ntype = "s16"
[[points]]\nfamily = "ssw07"\ncodes = ["P101"]\nstarters = ["pump-*"]
[[points]]\nfamily = "sst"\ncodes = ["R41"]
[history]\nvalues = ["torque_pct", "energy_kwh", "p101"]\n[[points]]\nfamily = "ssw07"\ncodes = ["P101"]
[homeassistant]\noperator = "alice"\ncommands = true\npage_url = "https://mcc1.plant:8480/page"
[homeassistant]\ndiscovery_prefix = "ha/one"\nbirth_topic = "ha/one/Status.1"
[homeassistant]\ndiscovery_prefix = "starters2"
[web]\n[metrics]\ntoken_file = "metrics.token"
[metrics]\ntextfile = "sg.prom"\nall_points = true
[web]\nlisten = "127.0.0.5:80"\nhosts = ["mcc1.plant", "mcc1"]\nbase_path = "/plant/mcc1"
[web]\nlisten = "0.0.0.0:8480"\nallow_plaintext = true\nUSER
[web]\nlisten = "[::]:8480"\ncert_file = "c.pem"\nkey_file = "k.pem"\nUSER
"""


def text_of(row: str) -> str:
    """Return the configuration of a row."""
    new = row.replace("\\n", "\n").replace("USER", USER).replace("LINE", LINE).replace("A65", "a" * 65)
    for short, text in {"ROW": ROW, "MENU": MENU, "LIMITS": LIMITS, "STARTER": STARTER}.items():
        new = new.replace(short, text)
    old, arrow, by = new.partition(" => ")
    return changed((old, by)) if arrow else f"{SITE}{new}\n"


@pytest.mark.parametrize("row", MISTAKES.strip().replace("\n    |", " |").splitlines())
def test_a_mistake_is_reported_with_its_key_and_the_hint_and_draws_at_most_one_other(row: str) -> None:
    what, _, problem = row.rpartition(" | ")

    text, found = text_of(what), []
    for beside in ("", "clock = 7\n"):  # another mistake, which no rule reads, hides none and draws none
        with pytest.raises(ConfigError) as caught:
            parse(text.replace("[gateway]\n", f"[gateway]\n{beside}"), "site.toml", check=check_watchdogs)
        found.append([str(each) for each in caught.value.problems])

    alone, both = found
    assert any(problem in each for each in alone), alone
    assert len(alone) <= 2
    assert any(problem.partition(": ")[2] in each for each in both), both
    assert len(both) == len(alone) + 1, both


@pytest.mark.parametrize("row", RIGHT.strip().splitlines())
def test_what_is_right_is_taken(row: str) -> None:
    parse(text_of(row), "site.toml", check=check_watchdogs)


HOME = '[homeassistant]\ndiscovery_prefix = "spBv1.0/{}"\nbirth_topic = "starters/mcc1"\n'
RULES = '[[rules]]\nstarters = ["pump-1"]\nfeeder = "a"\n'
P999 = '[[points]]\nfamily = "ssw07"\ncodes = ["P999"]\n'
UNNAMED = '[[operator]]\nmay = ["stop"]\nstarters = ["*"]\n[[operator]]'
SECOND = "line[0].starter[1]"


@pytest.mark.parametrize(
    ("wrong", "more", "also"),
    [
        (("every_s = 2.0", 'every_s = -1\npoints = ["P999"]'), "", [f"{SECOND}.points[0]"]),
        (("every_s = 2.0", 'evry_s = 2.0\npoints = ["P999"]'), "", [f"{SECOND}.points[0]"]),
        (("address = 2\n", 'slot = 1\nmodel = "SSW-06 85A"\n'), "", [f"{SECOND}.model"]),
        (("address = 1\n", 'address = "1"\n'), RULES, ["line[0].starter[0].name"]),
        (('family = "ssw900"', 'family = "x"\nslot = 1'), RULES, ["line[0].starter[0].name"]),
        (('"mcc1"', '"m 1"'), HOME, ["homeassistant.discovery_prefix"]),
        (("[mqtt]", '[mqtt]\nbase = "A"'), HOME, ["homeassistant.discovery_prefix"]),
        (('"ssw900"', '"x"'), RULES.replace("pump-1", '*-2", "fan'), ["rules[0].starters[1]"]),
        (('name = "pump-2"', 'name = "pump-1"'), RULES.replace("pump", "pmup"), ["rules[0].starters[0]"]),
        (('name = "pump-2"\n', ""), RULES.replace("pump", "pmup"), ["rules[0].starters[0]"]),
        (("[[operator]]", UNNAMED), '[homeassistant]\noperator = "alcie"', ["homeassistant.operator"]),
        (("[gateway]", "zzz = 1\n[gateway]"), P999, ["points[0].codes[0]"]),
        # Where the wrong key may decide about it, nothing is said that may be false.
        (("every_s = 2.0", 'every_s = 2.0\npoints = "P999"'), "", []),
        (("address = 2", 'address = 2\npionts = ["S1.1.1"]'), '[history]\nvalues = ["s1_1_1"]', []),
        (('family = "ssw900"', 'family = "x"'), '[history]\nvalues = ["s1_1_1"]', []),
        (("[mqtt]", "[wbe]\n[mqtt]"), "[metrics]", []),
        (('name = "pump-2"', 'name = "PUMP"'), "", []),
        (("every_s = 2.0", "watchdog_s = -1"), RULES + "stagger_s = 1.0\nminimum_pause_s = 1.0\n", []),
        (("every_s = 2.0", "every_s = 2.0"), RULES + 'stagger_s = "1"', []),
    ],
)
def test_a_wrong_value_hides_no_rule_that_does_not_read_it(
    wrong: tuple[str, str], more: str, also: list[str]
) -> None:
    with pytest.raises(ConfigError) as caught:
        parse(changed(wrong) + more, "site.toml", check=check_watchdogs)

    _, *others = sorted(caught.value.problems, key=lambda each: each.key in also)
    assert [each.key for each in others] == also


def test_a_password_in_place_of_its_line_is_not_shown() -> None:
    with pytest.raises(ConfigError) as caught:
        parse(text_of("[web]\\nUSER").replace(LINE, "hunter2hunter2"), "site.toml")

    (problem,) = caught.value.problems
    assert str(problem).partition(": ")[2] == (
        "web.user[0].password: is no password line (paste the line that starter-gateway web-password prints)"
    )
