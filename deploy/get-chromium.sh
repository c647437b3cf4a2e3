#!/usr/bin/env bash
# Sees to it that Chromium is there, for the tests of the status page: from the distribution, when we may. Never fails, except in CI.
set -euo pipefail

if command -v chromium > /dev/null || command -v google-chrome > /dev/null; then
    exit 0
fi
if [ "$(id -u)" = 0 ] && command -v apt-get > /dev/null; then
    echo "Installing Chromium from the distribution ..."
    export DEBIAN_FRONTEND=noninteractive
    { apt-get update -qq && apt-get install -y -qq --no-install-recommends chromium fonts-dejavu-core; } > /dev/null || true
fi
if ! command -v chromium > /dev/null; then
    echo "Not installed: chromium (apt-get install chromium): the tests of the status page are skipped." >&2
    if [ "${CI:-}" = true ]; then
        exit 1
    fi
fi
