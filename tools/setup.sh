#!/usr/bin/env bash
# Prepare a clone: install missing Debian packages, then pinned packages in .venv.
# Usage: tools/setup.sh run|dev      (run: what the daemon needs; dev: tests and lint too)
set -euo pipefail
cd "$(dirname "$0")/.."
level=${1:?usage: tools/setup.sh run|dev}
python=${PYTHON:-python3}

say() { printf 'setup: %s\n' "$*" >&2; }

if command -v "$python" >/dev/null && ! "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then
    say "$("$python" --version) is too old: Python 3.11 or newer is needed (Debian 12, Ubuntu 24.04, Raspberry Pi OS 12)."
    say "If a newer one is installed under another name: make PYTHON=python3.12 …"
    exit 1
fi

# Each requirement is tested by using it, not by its package's name: a compiler or Python may come from
# elsewhere. `packages` are needed before pip can begin; `others` are installed while pip works.
packages=()
others=()
if ! command -v "$python" >/dev/null; then
    packages+=(python3 python3-venv python3-dev)
else
    "$python" -c 'import venv, ensurepip' 2>/dev/null || packages+=(python3-venv)
    "$python" -c 'import os, sys, sysconfig; sys.exit(not os.path.exists(sysconfig.get_path("include") + "/Python.h"))' ||
        packages+=(python3-dev)
fi
printf 'int main() {}' | c++ -x c++ -o /dev/null - 2>/dev/null || packages+=(g++)
if [ "$level" = dev ]; then
    compiles() { printf '%s\nint main() { return 0; }\n' "$2" | ${1} -x c++ -o /dev/null - 2>/dev/null; }
    compiles 'c++ -fsyntax-only' '#include <doctest/doctest.h>' || others+=(doctest-dev)
    # The second compiler of the C++ tests, with sanitizers and libFuzzer.
    compiles 'clang++ -fsanitize=address,undefined' '#include <type_traits>' || others+=(clang libclang-rt-dev)
    command -v clang-tidy >/dev/null || others+=(clang-tidy)
    command -v cppcheck >/dev/null || others+=(cppcheck)
    # Servers and tools for tests of the outputs: brokers, certificates, a browser.
    PATH="$PATH:/usr/sbin" command -v mosquitto >/dev/null || others+=(mosquitto)
    PATH="$PATH:/usr/sbin" command -v nats-server >/dev/null || others+=(nats-server)
    command -v openssl >/dev/null || others+=(openssl)
    command -v chromium >/dev/null || others+=(chromium)
    # groff shows man pages.
    command -v groff >/dev/null || others+=(groff-base)
    # These check the service's files.
    command -v shellcheck >/dev/null || others+=(shellcheck)
    command -v systemd-analyze >/dev/null || others+=(systemd)
    # The Due's compiler with the headers of the C and C++ libraries. The libraries themselves, 2 GB, are in
    # other packages; no program is linked with them.
    compiles 'arm-none-eabi-g++ -mcpu=cortex-m3 -mthumb -c' '#include <type_traits>' ||
        others+=(gcc-arm-none-eabi libnewlib-dev libstdc++-arm-none-eabi-dev)
    # ccache saves the tests from compiling unchanged sources again.
    command -v ccache >/dev/null || others+=(ccache)
fi

as_root=
install() { $as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends "$@"; }
by_hand="sudo apt-get update && sudo apt-get install -y --no-install-recommends ${packages[*]} ${others[*]}"
if [ ${#packages[@]} -gt 0 ] || [ ${#others[@]} -gt 0 ]; then
    say "missing Debian packages: ${packages[*]} ${others[*]}"
    if ! command -v apt-get >/dev/null; then
        say "this is no Debian, Ubuntu or Raspberry Pi OS; install their counterparts, then call make again"
        exit 1
    elif [ "$(id -u)" = 0 ]; then
        :
    elif command -v sudo >/dev/null && { sudo -n true 2>/dev/null || [ -t 0 ]; }; then
        as_root=sudo
    else
        say "no right to install them; run this, then call make again:"
        say "    $by_hand"
        exit 1
    fi
    if ! { $as_root apt-get update -q && { [ ${#packages[@]} = 0 ] || install "${packages[@]}"; }; } >&2; then
        say "installing failed; see above, or run by hand: $by_hand"
        exit 1
    fi
fi

log=$(mktemp)
others_log=$(mktemp)
work=
others_work=
# A running apt-get is awaited, not killed: half an installation would block every later one.
trap 'rm -f "$log" "$others_log"; [ -z "$work" ] || kill "$work" 2>/dev/null || true; wait' EXIT
if [ ${#others[@]} -gt 0 ]; then
    install "${others[@]}" >"$others_log" 2>&1 &
    others_work=$!
fi
steps=4
[ "$level" != dev ] || steps=5
step=0

# Run one step: its name, then its command. A terminal shows the seconds and the command's last line of
# output.
quietly() {
    local name=$1 begin=$SECONDS text
    shift
    step=$((step + 1))
    say "$step/$steps $name"
    "$@" >"$log" 2>&1 &
    work=$!
    while [ -t 2 ] && kill -0 "$work" 2>/dev/null; do
        text="       $((SECONDS - begin)) s  $(tail -n 1 "$log" | tr -d '[:cntrl:]')"
        printf '\r\033[K%.*s' "$((${COLUMNS:-80} - 1))" "$text" >&2
        sleep 0.5
    done
    [ ! -t 2 ] || printf '\r\033[K' >&2
    wait "$work" || { work=; cat "$log" >&2; say "failed: $*"; exit 1; }
    work=
}

if .venv/bin/python -m pip --version >/dev/null 2>&1; then
    steps=$((steps - 1))
else
    quietly "making .venv" "$python" -m venv --clear .venv
fi
export PATH="$PWD/.venv/bin:$PATH" PIP_DISABLE_PIP_VERSION_CHECK=1
pip() { quietly "$1" .venv/bin/python -m pip "${@:2}"; }
# Install only files whose hashes tools/hashes.sh has recorded, and no dependencies beyond the list: pip
# checks each file. Packages without a wheel are compiled by the pinned tools.
checked=(install --require-hashes --no-deps --no-build-isolation)
pip "installing what builds the native module (cmake, ninja, nanobind)" \
    "${checked[@]}" -r tools/hashes/build.txt
# pip would compile bytecode on one core, which takes a quarter of its time.
[ "$level" != dev ] || checked+=(--no-compile)
pip "installing pinned Python packages ($level); this is most of the time" "${checked[@]}" -r "tools/hashes/$level.txt"
# Editable: an edited Python file takes effect at once.
pip "building the native module" install --no-deps --no-build-isolation \
    --config-settings=cmake.define.FLTEA_WERROR="${FLTEA_WERROR:-OFF}" -e .
# Some packages hold files that today's Python cannot compile; nothing imports them.
bytecode() { .venv/bin/python -m compileall -q -j 0 .venv/lib || true; }
[ "$level" != dev ] || quietly "making bytecode of them" bytecode
if [ -n "$others_work" ] && ! wait "$others_work"; then
    cat "$others_log" >&2
    say "installing failed; see above, or run by hand: $by_hand"
    exit 1
fi
say "ready"
