#!/usr/bin/env bash
# Sees to it that Mosquitto and its clients are there, and tshark for the tests: from the distribution, when we may. With --demo it
# wants no tshark and complains of nothing, since the demo has a broker of its own. Never fails, except in CI.
set -euo pipefail
cd "$(dirname "$0")"
. ./progress.sh

PATH="$PATH:/usr/local/sbin:/usr/sbin:/sbin"
programs="mosquitto mosquitto_sub mosquitto_pub tshark"
packages="mosquitto mosquitto-clients tshark"
if [ "${1:-}" = --demo ]; then
    programs=${programs% tshark} packages=${packages% tshark}
fi

missing() {
    local program
    for program in $programs; do
        command -v "$program" > /dev/null || echo "$program"
    done
}

install_packages() {
    export DEBIAN_FRONTEND=noninteractive
    apt-get update -qq && apt-get install -y -qq --no-install-recommends $packages
}

if [ -z "$(missing)" ]; then
    exit 0
fi
if [ "$(id -u)" = 0 ] && command -v apt-get > /dev/null; then
    with_progress "Installing Mosquitto from the distribution" install_packages || true
fi
if [ -n "$(missing)" ] && [ "${1:-}" != --demo ]; then
    echo "Not installed: $(missing | paste -sd ' ') (apt-get install $packages): the tests that need them are skipped." >&2
    if [ "${CI:-}" = true ]; then
        exit 1
    fi
fi
