#!/bin/sh
# Make the virtual environment $1, install this project into it (editable, with what its tests need),
# and see that MuJoCo can draw without a screen and that there is a browser to test the page in.
set -eu
venv=$1
python=${PYTHON:-python3}

"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || {
    echo "setup: $("$python" --version) is too old: Python 3.11 or newer is needed (make PYTHON=python3.11 ...)" >&2
    exit 2
}
"$venv/bin/python" -m pip --version >/dev/null 2>&1 || "$python" -m venv "$venv"
echo "setup: installing into $venv; a few minutes"
# --no-compile: of 20,000 files, Python compiles those that are imported, when they are
"$venv/bin/python" -m pip install --quiet --no-compile --editable '.[dev]'

# System libraries and programs, which pip cannot bring: OSMesa draws on the CPU, without a screen or a GPU, and EGL does
# where Mesa has OSMesa no longer; Chromium and its driver are for the tests of the browser page.
has() { "$venv/bin/python" -c 'import ctypes.util, sys; sys.exit(ctypes.util.find_library(sys.argv[1]) is None)' "$1"; }
has_browser() { command -v chromedriver >/dev/null 2>&1 && { command -v chromium || command -v google-chrome; } >/dev/null 2>&1; }
missing=
has OSMesa || missing=libosmesa6
has OSMesa || has EGL || missing="$missing libegl1 libgl1-mesa-dri"
has_browser || missing="$missing chromium chromium-driver"
[ -n "$missing" ] || exit 0
if command -v apt-get >/dev/null 2>&1; then
    if [ "$(id -u)" = 0 ]; then as_root=
    elif command -v sudo >/dev/null 2>&1 && sudo -n true 2>/dev/null; then as_root='sudo -n'
    else as_root=none
    fi
    if [ "$as_root" != none ]; then
        echo "setup: installing $missing"
        $as_root apt-get update -qq >/dev/null || true
        for package in $missing; do # one by one: what a distribution does not have must not keep the others out
            $as_root env DEBIAN_FRONTEND=noninteractive \
                apt-get install -y -qq --no-install-recommends "$package" >/dev/null || true
        done
    fi
fi
has OSMesa || has EGL || echo "setup: pictures need OSMesa or EGL; install one with: sudo apt-get install libosmesa6, or where that is no longer had: libegl1 libgl1-mesa-dri" >&2
has_browser || echo "setup: the tests of the page need Chromium; install it with: sudo apt-get install chromium chromium-driver" >&2
