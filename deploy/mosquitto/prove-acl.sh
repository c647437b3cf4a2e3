#!/usr/bin/env bash
# Proves on a running broker that its access list does what the gateway trusts it to do:
#   - no login commands under another's name,
#   - who only looks on commands nothing,
#   - only the gateway says what starters do, or what became of a command; neither with a last will,
#   - no client disconnects the gateway by using its client id, and receives its commands in its place.
# Every probe is for a starter that does not exist, and is seen, or not, by a login of its own that may read the whole
# branch. Stop the gateway before: the script uses its login. Passwords show in this machine's list of processes
# while the script runs.
#
#   deploy/mosquitto/prove-acl.sh [options] -- PUB_AND_SUB_OPTIONS..
#     --base B            of the topics (starters/mcc1)
#     --gateway U:P       login of the gateway (mcc1)
#     --client-id ID      of the gateway, when it is not the login's name
#     --prover U:P        login that may read everything and that no program uses meanwhile
#     --operator U:P      login of an operator; give two of them
#     --viewer U:P        login of somebody who only looks on; may be given again
#   What follows -- is passed to mosquitto_pub and mosquitto_sub, such as -h broker.plant -p 8883 --cafile ca.pem
#
# Exit code: 0 all proved, 1 something is open (or closed that must not be), 2 usage.
set -euo pipefail

base=starters/mcc1
gateway=
client_id=
prover=
operators=()
viewers=()
wait_s=2

usage() { sed -n '2,/^# Exit/s/^# \{0,1\}//p' "$0" >&2; exit 2; }

while [ $# -gt 0 ]; do
	case "$1" in
		--base) base="${2:?}"; shift 2 ;;
		--gateway) gateway="${2:?}"; shift 2 ;;
		--client-id) client_id="${2:?}"; shift 2 ;;
		--prover) prover="${2:?}"; shift 2 ;;
		--operator) operators+=("${2:?}"); shift 2 ;;
		--viewer) viewers+=("${2:?}"); shift 2 ;;
		--) shift; break ;;
		*) usage ;;
	esac
done
if [ -z "$gateway" ] || [ -z "$prover" ] || [ "${#operators[@]}" -lt 2 ] || [ "${#viewers[@]}" -lt 1 ]; then usage; fi

client_id="${client_id:-${gateway%%:*}}"
folder=$(mktemp -d)
listener=
victim=
trap 'for one in $listener $victim; do kill "$one" 2> /dev/null || true; done; rm -rf "$folder"' EXIT
token="probe-$$-$RANDOM$RANDOM"
failed=0

publish() { # LOGIN TOPIC PAYLOAD; without a login anonymously
	local login=()
	if [ -n "$1" ]; then login=(-u "${1%%:*}" -P "${1#*:}"); fi
	mosquitto_pub "${broker[@]}" "${login[@]}" -q 1 -t "$2" -m "$3" > /dev/null 2>&1 || true
}

leave_will() { # LOGIN TOPIC PAYLOAD: connect, and vanish
	mosquitto_sub "${broker[@]}" -u "${1%%:*}" -P "${1#*:}" -t "$base/acl-probe" \
		--will-topic "$2" --will-payload "$3" --will-qos 1 > /dev/null 2>&1 &
	local vanishing=$!
	sleep 0.5
	{ kill -KILL "$vanishing" && wait "$vanishing"; } 2> /dev/null || true
}

take_id() { # LOGIN - MARK: connect with the gateway's client id while somebody else has it with the gateway's login
	stdbuf -oL mosquitto_sub "${broker[@]}" -u "${gateway%%:*}" -P "${gateway#*:}" -i "$client_id" -d \
		-t "$base/acl-probe" > "$folder/victim" 2>&1 &
	victim=$!
	sleep 0.5
	mosquitto_sub "${broker[@]}" -u "${1%%:*}" -P "${1#*:}" -i "$client_id" -W 1 \
		-t "$base/acl-probe" > /dev/null 2>&1 || true
	sleep "$wait_s" # mosquitto_sub connects again after a second
	# One CONNACK: it has never had to.
	if ! kill -0 "$victim" 2> /dev/null || [ "$(grep -c CONNACK "$folder/victim")" -ne 1 ]; then
		echo " $3" >> "$folder/taken"
	fi
	{ kill "$victim" && wait "$victim"; } 2> /dev/null || true
	victim=
}

received() { grep -qF "$1" "$folder/received" "$folder/taken"; }

expect() { # arrives|is-refused LOGIN TOPIC WHAT [publish|leave_will|take_id]
	count=$((count + 1))
	"${5:-publish}" "$2" "$3" "$token-$count."
	probes+=("$1|$token-$count.|$4")
}

broker=("$@")
probes=()
count=0

touch "$folder/taken"
mosquitto_sub "${broker[@]}" -u "${prover%%:*}" -P "${prover#*:}" -q 1 -t "$base/#" -F '%t %p' \
	> "$folder/received" 2> "$folder/trouble" &
listener=$!
sleep "$wait_s"
if ! kill -0 "$listener" 2> /dev/null; then
	echo "the prover's login cannot listen: $(cat "$folder/trouble")" >&2
	exit 1
fi

said="$base/starter/acl-probe/state"
expect arrives "$gateway" "$said" "the gateway says what a starter does"
for one in "${operators[@]}"; do
	me="${one%%:*}"
	expect arrives "$one" "$base/command/acl-probe/$me/read" "$me commands under the own name"
	expect is-refused "$one" "$said" "$me says what a starter does"
	expect is-refused "$one" "$base/result/acl-probe/$me" "$me publishes a result to itself"
	expect is-refused "$one" "$base/gateway/status" "$me speaks for the gateway"
	expect is-refused "$one" "$base/audit" "$me writes into the books"
	expect is-refused "$one" - "$me takes the gateway's client id, and its commands" take_id
	for other in "${operators[@]}"; do
		if [ "$other" != "$one" ]; then
			as_other="$base/command/acl-probe/${other%%:*}/read"
			expect is-refused "$one" "$as_other" "$me commands as ${other%%:*}"
			expect is-refused "$one" "$as_other" "$me commands as ${other%%:*} by a last will" leave_will
			expect is-refused "$one" "$base/result/acl-probe/${other%%:*}" "$me publishes a result to ${other%%:*}"
		fi
	done
done
for one in "${viewers[@]}"; do
	me="${one%%:*}"
	expect is-refused "$one" "$base/command/acl-probe/$me/read" "$me, who only looks on, commands"
	expect is-refused "$one" "$base/command/acl-probe/${operators[0]%%:*}/read" "$me commands as ${operators[0]%%:*}"
	expect is-refused "$one" "$said" "$me says what a starter does"
	expect is-refused "$one" "$said" "$me says it by a last will" leave_will
	expect is-refused "$one" "$base/result/acl-probe/${operators[0]%%:*}" "$me publishes a result to ${operators[0]%%:*}"
	expect is-refused "$one" "$base/gateway/status" "$me speaks for the gateway"
	expect is-refused "$one" "$base/audit" "$me writes into the books"
	expect is-refused "$one" - "$me takes the gateway's client id, and its commands" take_id
done
expect is-refused "" "$base/command/acl-probe/${operators[0]%%:*}/read" "somebody without a login commands"
expect is-refused "" "$said" "somebody without a login says what a starter does"
expect is-refused "$gateway" "$base/command/acl-probe/${operators[0]%%:*}/read" "the gateway gives itself a command"
expect arrives "$gateway" "$said" "the gateway's messages still arrive at the end"
sleep "$wait_s"

for probe in "${probes[@]}"; do
	IFS='|' read -r wanted payload what <<< "$probe"
	verdict=is-refused
	if received " $payload"; then verdict=arrives; fi
	if [ "$verdict" = "$wanted" ]; then
		echo "ok    $what: ${wanted/-/ }"
	else
		echo "WRONG $what: ${verdict/-/ }, but ${wanted/-/ } is right"
		failed=$((failed + 1))
	fi
done
echo "${#probes[@]} probes, $failed wrong"
[ "$failed" -eq 0 ]
