#!/usr/bin/env bash
# Run what was built: for aarch64 the C++ tests and the wheel under QEMU, for this machine the wheel with
# every installed version of Python. The figures of a simulated record must be the same everywhere. Takes a
# minute.
# Usage: tools/dist/try.sh
set -euo pipefail
cd "$(dirname "$0")/../.."
# shellcheck source=tools/dist/common.sh
. tools/dist/common.sh
need qemu-aarch64-static qemu-user-static
folder=$work/try
mkdir -p "$folder/doctest"

say "the C++ tests, compiled for aarch64, under QEMU"
# -Wno-maybe-uninitialized: gcc for ARM does not see that a filter with N states writes all of them. doctest
# is copied, since the cross compiler does not search /usr/include. No sanitizers: QEMU does not support them.
cp -r /usr/include/doctest "$folder/doctest/"
need aarch64-linux-gnu-g++ g++-aarch64-linux-gnu
make --silent -j2 -C tests/native BUILD="$folder/native" SETS=baseline CXX="aarch64-linux-gnu-g++ -isystem $folder/doctest" \
    FLAGS="-std=gnu++11 -g1 -O2 -ffp-contract=off -Wall -Wextra -Werror -Wno-maybe-uninitialized -static" strict tests
(cd tests/native && qemu-aarch64-static "$folder/native/tests" >"$folder/native.log") ||
    { tail -n 40 "$folder/native.log" >&2; refuse "the C++ tests fail on aarch64"; }
tail -n 3 "$folder/native.log" >&2

root=$(arm_root)
# Print the path of a Python of this version: on PATH, or installed by pyenv.
python_for() { # VERSION
    local found
    for found in "$(command -v "python$1")" "${PYENV_ROOT:-$HOME/.pyenv}/versions/$1".*/bin/python; do
        "$found" -c '' 2>/dev/null && printf '%s\n' "$found" && return
    done
    return 1
}
figures() { # MACHINE PYTHON COMMAND…    (COMMAND: what runs this Python)
    local name=$1-$2 run=("${@:3}")
    say "the wheel for $1 with Python $2: estimates and a verdict of the same record"
    install_into "$1" "$2" "$folder/$name"
    # -S leaves site out: packages come from this folder alone, not from the clone.
    fltea() { PYTHONPATH=$folder/$name "${run[@]}" -P -S -m fltea "$@"; }
    [ -e "$folder/record.npz" ] || fltea simulate "$folder/record.npz" --alpha 0.5 --f -1 -n 3000 --seed 1
    fltea run --source "replay:$folder/record.npz" --once --set live.on=false >"$folder/$name.run.ndjson"
    fltea identify "$folder/record.npz" --channels gyro_x --shuffles 2 --jobs 1 --json >"$folder/$name.identify.json"
    [ "$name" = "$(uname -m)-3.11" ] || {
        "$python" tools/dist/same_figures.py "$folder/$(uname -m)-3.11.run.ndjson" "$folder/$name.run.ndjson" --exactly
        "$python" tools/dist/same_figures.py "$folder/$(uname -m)-3.11.identify.json" "$folder/$name.identify.json"
    }
}
figures "$(uname -m)" 3.11 "$python"
for other in 3.12 3.13 3.14; do
    if found=$(python_for "$other"); then
        figures "$(uname -m)" "$other" "$found"
    else
        say "not tried with Python $other, which is not on this machine"
    fi
done
figures aarch64 3.11 qemu-aarch64-static -L "$root" "$root/usr/bin/python3.11"

say "golden vectors and golden values of the estimator, with the wheel for aarch64"
entries dev 'pytest|iniconfig|packaging|pluggy|pygments|hypothesis|sortedcontainers|pytest-timeout' >"$folder/pytest.txt"
unpack_for aarch64 3.11 "$folder/pytest" "$folder/pytest.txt"
# Tests that start other programs are left out: this machine's kernel runs no aarch64 programs.
PYTHONPATH=$folder/aarch64-3.11:$folder/pytest qemu-aarch64-static -L "$root" "$root/usr/bin/python3.11" -P -S -m pytest -q \
    -p no:cacheprovider -k "not files_are_what" tests/protocol/test_vectors.py tests/estimator/test_numbers.py
