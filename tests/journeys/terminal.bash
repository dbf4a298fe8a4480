# The shell of a reader who types the commands of a document in a new folder.
set -euo pipefail

# Starts a server in place of the previous one, and waits until it is ready.
host() {
    if [ -n "${HOSTING:-}" ]; then
        kill "$HOSTING" 2>/dev/null || true
        wait "$HOSTING" || true
    fi
    # Emptied here: the background job truncates the file later than the first grep may read it.
    : >host.txt
    "$AVLN_BIN" "$@" >>host.txt 2>&1 &
    HOSTING=$!
    until grep -q '^Stop with' host.txt; do
        kill -0 "$HOSTING" 2>/dev/null || { cat host.txt >&2; return 1; }
        sleep 0.1
    done
}
trap 'kill ${HOSTING:-} 2>/dev/null || true' EXIT

avln() {
    case " $* " in
        " demo "* | *" serve "*) host "$@" ;;
        *" team add "* | *" token new --team "*)
            "$AVLN_BIN" "$@" | tee token.txt
            TOKEN=$(grep -o 'avln_[A-Za-z0-9_]*' token.txt)
            ;;
        *" token new --organiser "*)
            "$AVLN_BIN" "$@" | tee token.txt
            ORGANISER=$(grep -o 'avln_[A-Za-z0-9_]*' token.txt)
            ;;
        *"agent random "*)
            "$AVLN_BIN" "$@" | tee run.txt
            RUN=$(grep -o 'run_[0-9a-f]*' run.txt | head -n 1)
            ;;
        *) "$AVLN_BIN" "$@" ;;
    esac
}

# Stops the bridge as soon as it listens.
avln-bridge() {
    command avln-bridge "$@" >bridge.txt 2>&1 &
    local bridge=$!
    until grep -q 'tcp://' bridge.txt; do
        kill -0 "$bridge" 2>/dev/null || { cat bridge.txt >&2; return 1; }
        sleep 0.1
    done
    kill "$bridge"
}

# An example program, compiled with the tests.
example() {
    local program="$EXAMPLES/$1"
    [ -x "$program" ] || { echo "there is no $program; cargo build --workspace --examples makes it" >&2; return 1; }
    "$program" "${@:2}"
}

# The server's public log key.
log_key() {
    curl -fsS "http://$AVLN_WEB/api/v1/status" | grep -o '"log_key":"[^"]*"' | cut -d '"' -f 4
}
