# shellcheck shell=bash
# Settings and functions that the scripts of this folder share; they source it from the repository's root.
# shellcheck disable=SC2034
out=$PWD/build/dist
work=$out/work
python=$PWD/.venv/bin/python
# The stable ABI: one wheel per machine serves this version of Python and all later ones.
abi=cp311-abi3
# The oldest glibc that auditwheel accepts for Debian 12's compiler; Debian 12, Ubuntu 22.04 and RHEL 9 have
# it.
glibc=2_34
# The systems with a Debian package. Each has its own version of Python, for which the libraries are chosen.
systems=(deb12 deb13 ubuntu24.04)
declare -A python_of=([deb12]=3.11 [deb13]=3.13 [ubuntu24.04]=3.12)
declare -A suite_of=([deb12]=bookworm [deb13]=trixie [ubuntu24.04]=noble)
version=$(sed -n 's/^version = "\(.*\)"/\1/p' pyproject.toml)
# Timestamps in the files are the commit's, so that two builds give the same bytes.
SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct 2>/dev/null || stat -c %Y CHANGELOG.md)}
export SOURCE_DATE_EPOCH PIP_DISABLE_PIP_VERSION_CHECK=1 PATH="$PWD/.venv/bin:$PATH"

say() { printf 'dist: %s\n' "$*" >&2; }
refuse() { printf 'dist: error: %s\n' "$*" >&2; exit 1; }

need() { # COMMAND PACKAGE
    command -v "$1" >/dev/null || refuse "$1 is missing: apt-get install $2"
}

# File names of the wheel and the package for a machine. The package's version names the system, as backports
# do.
wheel_of() { printf '%s\n' "$out/fltea-$version-$abi-manylinux_${glibc}_$1.whl"; }            # MACHINE
deb_of() { printf '%s\n' "$out/fltea_$version-1~${1}_$2.deb"; }                               # SYSTEM ARCHITECTURE
machine_of() { case $1 in amd64) echo x86_64 ;; arm64) echo aarch64 ;; *) refuse "no rule to build for $1" ;; esac; }

# Make a bare system in a folder, or one that is used and thrown away (/dev/null). apt runs as root, because
# inside a sandbox its own user may be allowed neither gpgv nor the network.
bare() { # SUITE FOLDER OPTION…
    need mmdebstrap mmdebstrap
    local archive=http://deb.debian.org/debian components=main
    [ "$1" != noble ] || { archive=http://archive.ubuntu.com/ubuntu components='main universe'; }
    # shellcheck disable=SC2016  # $1: the folder, set by mmdebstrap
    mmdebstrap --quiet --aptopt='APT::Sandbox::User "root"' "${@:3}" "$1" "$2" "deb $archive $1 $components"
}

# Extract Debian 12's Python for aarch64, without installing it: its headers for the build, and its program to
# run under QEMU.
arm_root() {
    if [ ! -e "$work/arm64/usr/bin/python3.11" ]; then
        say "extracting Debian 12 for arm64 into $work/arm64"
        rm -rf "$work/arm64"
        bare bookworm "$work/arm64" --variant=extract --architectures=arm64 \
            --include=python3.11,libpython3.11-dev,libstdc++6 >&2
    fi
    printf '%s\n' "$work/arm64"
}

# Set the environment that pip, CMake and scikit-build-core need to build for aarch64.
cross_environment() {
    need aarch64-linux-gnu-g++ g++-aarch64-linux-gnu
    FLTEA_TARGET_ROOT=$(arm_root)
    export FLTEA_TARGET_ROOT CMAKE_TOOLCHAIN_FILE=$PWD/tools/dist/aarch64.cmake _PYTHON_HOST_PLATFORM=linux-aarch64
}

# Print the packages, with hashes, of a list in tools/hashes whose names match a regular expression;
# entries_but prints the packages that do not match.
entries() { # LIST NAMES
    awk -v names="^($2)==" '/^[a-z]/ { of_it = $0 ~ names } of_it' "tools/hashes/$1.txt"
}
entries_but() { # LIST NAMES
    awk -v names="^($2)==" '/^[a-z]/ { of_it = $0 !~ names } of_it' "tools/hashes/$1.txt"
}

# Unpack packages for a machine and a version of Python into a folder that is put on Python's path. Nothing is
# compiled, and a package is refused unless its hash is in the list.
unpack_for() { # MACHINE PYTHON FOLDER LIST
    local machine=$1 level levels=()
    for level in 34 31 28 27 26 24 17; do levels+=(--platform "manylinux_2_${level}_$machine"); done
    rm -rf "$3"
    "$python" -m pip install --quiet --target "$3" --no-compile --no-deps --require-hashes -r "$4" \
        --only-binary :all: --implementation cp --python-version "$2" --abi "cp${2/./}" --abi abi3 --abi none \
        --platform "linux_$machine" --platform "manylinux2014_$machine" "${levels[@]}"
}

# Install the wheel and all libraries that the service may need: what `make run` installs except the board's
# emulator. The only wheel of cobs is 1.2.0, in pure Python, which is fast enough for what the program
# encodes.
install_into() { # MACHINE PYTHON FOLDER
    local wheel list=$work/needed-$1-$2.txt
    wheel=$(wheel_of "$1")
    [ -e "$wheel" ] || tools/dist/wheels.sh "$1"
    mkdir -p "$work"
    {
        entries_but run 'cobs|unicorn'
        entries dist cobs
        printf '%s --hash=sha256:%s\n' "$wheel" "$(sha256sum "$wheel" | cut -d' ' -f1)"
    } >"$list"
    unpack_for "$1" "$2" "$3" "$list"
}
