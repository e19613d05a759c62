# shellcheck shell=bash
# What the scripts of this folder share; they source it from the repository's root.
# shellcheck disable=SC2034
out=$PWD/build/dist
work=$out/work
python=$PWD/.venv/bin/python
abi=cp311
# The lowest that auditwheel finds for Debian 12's compiler; Debian 12, Ubuntu 22.04 and RHEL 9 have it.
glibc=2_34
# What of the optional parts the Debian package holds: what the service may be asked for.
parts='[outputs]'
version=$(sed -n 's/^version = "\(.*\)"/\1/p' pyproject.toml)
# Times in the files are the commit's: built twice they are the same.
SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct 2>/dev/null || stat -c %Y CHANGELOG.md)}
export SOURCE_DATE_EPOCH PIP_DISABLE_PIP_VERSION_CHECK=1 PATH="$PWD/.venv/bin:$PATH"

say() { printf 'dist: %s\n' "$*" >&2; }
refuse() { printf 'dist: error: %s\n' "$*" >&2; exit 1; }

need() { # COMMAND PACKAGE
    command -v "$1" >/dev/null || refuse "$1 is missing: apt-get install $2"
}

# Debian 12's Python for aarch64: its headers to build with, and itself to be run under QEMU. Extracted, not installed.
arm_root() {
    need mmdebstrap mmdebstrap
    if [ ! -e "$work/arm64/usr/bin/python3.11" ]; then
        say "extracting Debian 12 for arm64 into $work/arm64"
        rm -rf "$work/arm64"
        mmdebstrap --quiet --variant=extract --architectures=arm64 --include=python3.11,libpython3.11-dev,libstdc++6 \
            bookworm "$work/arm64" "deb http://deb.debian.org/debian bookworm main" >&2
    fi
    printf '%s\n' "$work/arm64"
}

# What pip, setuptools, CMake and scikit-build-core need to build for aarch64.
cross_environment() {
    need aarch64-linux-gnu-g++ g++-aarch64-linux-gnu
    FLTEA_TARGET_ROOT=$(arm_root)
    include=$FLTEA_TARGET_ROOT/usr/include
    export FLTEA_TARGET_ROOT CMAKE_TOOLCHAIN_FILE=$PWD/tools/dist/aarch64.cmake
    export _PYTHON_HOST_PLATFORM=linux-aarch64 SETUPTOOLS_EXT_SUFFIX=.cpython-311-aarch64-linux-gnu.so
    export CC=aarch64-linux-gnu-gcc CXX=aarch64-linux-gnu-g++
    export CFLAGS="-O2 -I$include/python3.11 -idirafter $include"
}

# Packages for another machine or this one, into a folder that Python only has to be shown.
unpack_for() { # MACHINE FOLDER PACKAGE…
    local machine=$1 folder=$2 level levels=()
    for level in 34 31 28 27 26 24 17; do levels+=(--platform "manylinux_2_${level}_$machine"); done
    rm -rf "$folder"
    "$python" -m pip install --quiet --target "$folder" --no-compile -c constraints.txt --find-links "$work/$machine/libraries" \
        --only-binary :all: --implementation cp --python-version 3.11 --abi cp311 --abi abi3 --abi none \
        --platform "linux_$machine" --platform "manylinux2014_$machine" "${levels[@]}" "${@:3}"
}

# The wheel and all that it needs.
install_into() { # MACHINE FOLDER [PARTS]
    local machine=$1 libraries=$work/$1/libraries
    local wheel=$out/fltea-$version-$abi-$abi-manylinux_${glibc}_$machine.whl
    [ -e "$wheel" ] || tools/dist/wheels.sh "$machine"
    # Of cobs only old versions are published as a wheel: the one library that is compiled here.
    if ! ls "$libraries"/cobs-*.whl >/dev/null 2>&1; then
        (
            [ "$machine" = "$(uname -m)" ] || cross_environment
            # Not as the interpreter was linked, which may name folders of this machine.
            LDSHARED="${CC:-gcc} -shared -s" "$python" -m pip wheel --quiet --no-cache-dir --no-deps --no-build-isolation \
                --no-binary cobs -c constraints.txt --wheel-dir "$libraries" cobs
        )
    fi
    unpack_for "$machine" "$2" "$wheel${3:-}"
}
