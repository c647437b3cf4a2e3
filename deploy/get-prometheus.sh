#!/usr/bin/env bash
# Sees to it that prometheus and promtool are there, for the tests of the metrics: the distribution's programs alone, when we may.
# The package itself is not installed: it would start a service. Never fails, except in CI.
set -euo pipefail

missing() {
    local program
    for program in prometheus promtool; do
        command -v "$program" > /dev/null || echo "$program"
    done
}

fetch() {
    local folder
    folder=$(mktemp -d)
    trap 'rm -rf "$folder"' RETURN
    { apt-get update -qq && (cd "$folder" && apt-get download -qq -o APT::Sandbox::User=root prometheus); } > /dev/null || return 1
    dpkg-deb --extract "$folder"/prometheus_*.deb "$folder/files"
    install -m 755 "$folder/files/usr/bin/prometheus" "$folder/files/usr/bin/promtool" /usr/local/bin/
}

if [ -z "$(missing)" ]; then
    exit 0
fi
if [ "$(id -u)" = 0 ] && command -v apt-get > /dev/null; then
    echo "Fetching prometheus and promtool from the distribution ..."
    fetch || true
fi
if [ -n "$(missing)" ]; then
    echo "Not here: $(missing | paste -sd ' ') (apt-get install prometheus): the tests that need them are skipped." >&2
    if [ "${CI:-}" = true ]; then
        exit 1
    fi
fi
