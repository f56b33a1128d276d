#!/bin/sh
# Print the Python to use (3.11 to 3.14, with venv and headers) and make sure of a C++ compiler. What is missing is
# installed with apt when run as root; otherwise one line says what to type.
set -u

is_usable() {
    "$1" - <<'PYTHON' >/dev/null 2>&1
import ensurepip, os, sys, sysconfig, venv
has_headers = os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h"))
sys.exit(not ((3, 11) <= sys.version_info[:2] <= (3, 14) and has_headers))
PYTHON
}

find_python() {
    for name in ${PYTHON:-} python3 /usr/bin/python3 python3.12 python3.11 python3.13 python3.14; do
        if is_usable "$name"; then
            "$name" -c 'import sys; print(sys.executable)'
            return 0
        fi
    done
    return 1
}

missing_packages() {
    command -v "${CC:-gcc}" >/dev/null 2>&1 || printf 'gcc '
    command -v "${CXX:-g++}" >/dev/null 2>&1 || printf 'g++ '
    find_python >/dev/null || printf 'python3 python3-venv python3-dev '
}

packages=$(missing_packages)
if [ -n "$packages" ] && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1; then
    echo "installing $packages" >&2
    # shellcheck disable=SC2086  # a list of words
    { apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $packages; } >&2
    packages=$(missing_packages)
fi
if [ -n "$packages" ]; then
    echo "missing tools (Python 3.11 to 3.14 is needed); type: sudo apt-get install ${packages% }" >&2
    exit 1
fi
find_python
