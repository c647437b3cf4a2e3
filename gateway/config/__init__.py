"""The configuration file: TOML to checked models; pure.

Start at `reading`; `schema` has the tables, `cross_checks` the rules across them, `convert` plain values
for lower packages.
"""

from gateway.config.convert import (
    broker_of,
    least_watchdog_s,
    policy_of,
    rights_of,
    setups_in,
    setups_of,
    timing_of,
    wiring_of,
)
from gateway.config.diff import ConfigChanges, changes_of, fixed
from gateway.config.integration_tables import HomeAssistantTable, SparkplugTable
from gateway.config.mistakes import WHERE_RIGHT, Mistake, choose
from gateway.config.reading import load, parse
from gateway.config.schema import Baud, Config, FramingText, LineTable, StarterTable, Verb
from gateway.config.secrets import SECRETS, VARIABLE, files_of, password_in, secret_of, without_logins
from gateway.config.simulated_tables import SimulatedMotorTable
from gateway.config.values import SCHEMES, is_loopback, split_listen, split_url
