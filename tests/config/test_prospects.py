from __future__ import annotations

from pathlib import Path

import pytest

from gateway.app.capacity import computed_of, prospects_of
from gateway.config.convert import tls_of
from gateway.mqtt.connection.settings import TlsSettings
from tests.config.sites import site


def test_a_starter_is_left_for_a_period_and_a_sweep_at_most() -> None:
    (line,) = prospects_of(site())

    first, second = line.starters

    assert 0.5 * line.forecast.sweep_s < first.gap_s - 1.0 < 2 * line.forecast.sweep_s
    assert second.gap_s == pytest.approx(first.gap_s + 1.0, rel=0.05)


def test_the_statistics_of_a_line_are_those_of_its_worst_starter() -> None:
    (line,) = prospects_of(site(("every_s = 2.0", "every_s = 2.0\nwatchdog_s = 10.0")))

    computed = computed_of(line)

    assert computed["watchdog_margin_s"] == round(10.0 - line.forecast.watchdog_gaps_s[2], 4)
    assert computed["stop_latency_s"] == round(line.forecast.stop_latency_s, 4)
    assert computed["is_paced"] is True
    assert computed_of(prospects_of(site())[0])["watchdog_margin_s"] is None


def test_files_are_looked_for_beside_the_configuration() -> None:
    config = site(("[mqtt]", '[mqtt]\nca_file = "ca.pem"\ncert_file = "/etc/c.pem"\nkey_file = "k.pem"'))

    assert tls_of(config.mqtt, Path("/etc/gw")) == TlsSettings(
        "/etc/gw/ca.pem", "/etc/c.pem", "/etc/gw/k.pem"
    )
    assert tls_of(site().mqtt, Path("/etc/gw")) == TlsSettings()
