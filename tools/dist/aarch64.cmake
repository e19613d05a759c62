# CMake's toolchain of the wheel for aarch64 (a Raspberry Pi with a 64-bit system): Debian's cross compiler.
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_SYSTEM_PROCESSOR aarch64)
set(CMAKE_C_COMPILER aarch64-linux-gnu-gcc)
set(CMAKE_CXX_COMPILER aarch64-linux-gnu-g++)
set(CMAKE_STRIP aarch64-linux-gnu-strip)
set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)

# Of the target's Python only headers are needed: a module is not linked with libpython. The interpreter is this
# machine's, and has the same version. Debian's pyconfig.h is in a folder of its own below /usr/include, which is
# searched last, so that libc's headers are the cross compiler's.
set(Python_INCLUDE_DIR "$ENV{FLTEA_TARGET_ROOT}/usr/include/python3.11")
string(APPEND CMAKE_CXX_FLAGS_INIT " -idirafter $ENV{FLTEA_TARGET_ROOT}/usr/include")
# This compiler does not see that a filter with N states writes all of them.
string(APPEND CMAKE_CXX_FLAGS_INIT " -Wno-maybe-uninitialized")
