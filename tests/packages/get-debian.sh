#!/usr/bin/env bash
# Makes fresh Debian systems for the tests of the packages, as archives in build/debian: bookworm.tar and trixie.tar, from
# where apt gets its packages on this machine; and sees to lintian and buildah. Needs root and mmdebstrap. Never fails.
set -euo pipefail
cd "$(dirname "$0")/../.."

target=build/debian
suites="bookworm trixie"
include=python3,systemd,udev,procps,openssl,mosquitto,mosquitto-clients

is_there() {
    local suite
    [ "$(cat "$target/include" 2> /dev/null)" = "$include" ] || return 1
    command -v lintian > /dev/null && command -v buildah > /dev/null || return 1
    for suite in $suites; do
        [ -e "$target/$suite.tar" ] || return 1
    done
}

mirror() { # of main, whatever the format of apt's lists
    apt-get indextargets --format '$(REPO_URI) $(RELEASE) $(COMPONENT)' 'Created-By: Packages' |
        awk '$2 ~ /^[a-z]+$/ && $3 == "main" { print $1; exit }'
}

make_system() {
    local suite=$1
    [ -e "$target/$suite.tar" ] && return 0
    timeout 400 nice -n 5 mmdebstrap --quiet --variant=minbase --include="$include" \
        --dpkgopt='path-exclude=/usr/share/locale/*' \
        "$suite" "$target/$suite.new.tar" "$(mirror)" 2> "$target/$suite.log" || return 1
    mv "$target/$suite.new.tar" "$target/$suite.tar"
}

is_there && exit 0
if [ "$(id -u)" = 0 ] && command -v apt-get > /dev/null; then
    export DEBIAN_FRONTEND=noninteractive
    mkdir -p "$target"
    if ! command -v mmdebstrap > /dev/null || ! command -v lintian > /dev/null || ! command -v buildah > /dev/null; then
        { apt-get update -qq && apt-get install -y -qq --no-install-recommends mmdebstrap lintian buildah; } > /dev/null || true
    fi
    [ "$(cat "$target/include" 2> /dev/null)" = "$include" ] || rm -f "$target"/*.tar # of another list
    echo "$include" > "$target/include"
    echo "Making fresh systems of Debian for the tests of the packages (a minute or two) ..."
    for suite in $suites; do
        make_system "$suite" &
    done
    wait || true
fi
if ! is_there; then
    echo "Not here: fresh systems of Debian (root and mmdebstrap are needed) lintian or buildah: the tests of packages and image are skipped." >&2
fi
