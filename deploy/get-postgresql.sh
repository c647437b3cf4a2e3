#!/usr/bin/env bash
# Sees to it that PostgreSQL's programs are there, for the tests of deploy/contrib/postgresql: from the distribution, when
# we may; no cluster is made, nothing is started. Never fails, except as root in CI.
set -euo pipefail

is_there() { compgen -G '/usr/lib/postgresql/*/bin/postgres' > /dev/null; }

if is_there; then
    exit 0
fi
if [ "$(id -u)" = 0 ] && command -v apt-get > /dev/null; then
    echo "Installing PostgreSQL from the distribution ..."
    export DEBIAN_FRONTEND=noninteractive
    if [ ! -e /etc/postgresql-common/createcluster.conf ]; then
        mkdir -p /etc/postgresql-common
        echo 'create_main_cluster = false' > /etc/postgresql-common/createcluster.conf
    fi
    { apt-get update -qq && apt-get install -y -qq --no-install-recommends postgresql; } > /dev/null || true
fi
if ! is_there; then
    echo "Not installed: PostgreSQL (apt-get install postgresql): the test of its consumer is skipped." >&2
    if [ "${CI:-}" = true ] && [ "$(id -u)" = 0 ]; then
        exit 1
    fi
fi
