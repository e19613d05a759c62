#!/usr/bin/env bash
# Runs what was built for aarch64 under QEMU: the C++ tests, then the wheel on a made-up record, whose figures must be
# those of the wheel for this machine. Takes a minute.
# Usage: tools/dist/try.sh
set -euo pipefail
cd "$(dirname "$0")/../.."
# shellcheck source=tools/dist/common.sh
. tools/dist/common.sh
need qemu-aarch64-static qemu-user-static
folder=$work/try
mkdir -p "$folder/doctest"

say "the C++ tests, compiled for aarch64, under QEMU"
# The cross compiler does not look into /usr/include, where doctest is. Without sanitizers, which QEMU does not know.
cp -r /usr/include/doctest "$folder/doctest/"
need aarch64-linux-gnu-g++ g++-aarch64-linux-gnu
make --silent -j2 -C tests/native BUILD="$folder/native" SETS=baseline CXX="aarch64-linux-gnu-g++ -isystem $folder/doctest" \
    FLAGS="-std=gnu++11 -g1 -O2 -ffp-contract=off -Wall -Wextra -Werror -static" strict tests
(cd tests/native && qemu-aarch64-static "$folder/native/tests" >"$folder/native.log") ||
    { tail -n 40 "$folder/native.log" >&2; refuse "the C++ tests fail on aarch64"; }
tail -n 3 "$folder/native.log" >&2

root=$(arm_root)
for machine in x86_64 aarch64; do
    say "the wheel for $machine: estimates and a verdict of the same record"
    install_into "$machine" "$folder/$machine"
    run=("$python")
    [ "$machine" = "$(uname -m)" ] || run=(qemu-aarch64-static -L "$root" "$root/usr/bin/python3.11")
    # Without site: of packages only what is in this folder, and not the clone's own.
    fltea() { PYTHONPATH=$folder/$machine "${run[@]}" -P -S -m fltea "$@"; }
    [ -e "$folder/record.npz" ] || fltea simulate "$folder/record.npz" --alpha 0.5 --f -1 -n 3000 --seed 1
    fltea run --source "replay:$folder/record.npz" --once --set live.on=false >"$folder/$machine.run.ndjson"
    fltea identify "$folder/record.npz" --channels gyro_x --shuffles 2 --jobs 1 --json >"$folder/$machine.identify.json"
done
"$python" tools/dist/same_figures.py "$folder"/{x86_64,aarch64}.run.ndjson --exactly
"$python" tools/dist/same_figures.py "$folder"/{x86_64,aarch64}.identify.json

say "golden vectors and golden values of the estimator, with the wheel for aarch64"
unpack_for aarch64 "$folder/pytest" pytest hypothesis pytest-timeout
# Without what starts other programs: this machine's kernel runs none for aarch64.
PYTHONPATH=$folder/aarch64:$folder/pytest qemu-aarch64-static -L "$root" "$root/usr/bin/python3.11" -P -S -m pytest -q \
    -p no:cacheprovider -k "not files_are_what" tests/protocol/test_vectors.py tests/estimator/test_golden.py
