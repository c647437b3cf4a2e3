#!/usr/bin/env bash
# Sees to it that Mosquitto, its clients and tshark are there: from the distribution, when we may. Never fails, except in CI.
set -euo pipefail

PATH="$PATH:/usr/local/sbin:/usr/sbin:/sbin"

missing() {
    local program
    for program in mosquitto mosquitto_sub mosquitto_pub tshark; do
        command -v "$program" > /dev/null || echo "$program"
    done
}

if [ -z "$(missing)" ]; then
    exit 0
fi
if [ "$(id -u)" = 0 ] && command -v apt-get > /dev/null; then
    echo "Installing Mosquitto from the distribution ..."
    export DEBIAN_FRONTEND=noninteractive
    { apt-get update -qq && apt-get install -y -qq --no-install-recommends mosquitto mosquitto-clients tshark; } || true
fi
if [ -n "$(missing)" ]; then
    echo "Not installed: $(missing | paste -sd ' ') (apt-get install mosquitto mosquitto-clients tshark)." >&2
    if [ "${CI:-}" = true ]; then
        exit 1
    fi
    echo "Going on without: the demo has a broker of its own, tests that need them are skipped." >&2
fi
