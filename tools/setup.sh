#!/bin/sh
# Make the virtual environment $1, install this project into it (editable, with what its tests need),
# and see that MuJoCo can draw without a screen.
set -eu
venv=$1
python=${PYTHON:-python3}

"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || {
    echo "setup: $("$python" --version) is too old: Python 3.11 or newer is needed (make PYTHON=python3.11 ...)" >&2
    exit 2
}
"$venv/bin/python" -m pip --version >/dev/null 2>&1 || "$python" -m venv "$venv"
echo "setup: installing into $venv; a few minutes"
"$venv/bin/python" -m pip install --quiet --editable '.[dev]'

# OSMesa draws on the CPU, without a screen or a GPU. It is a system library: pip cannot bring it.
has_osmesa() { "$venv/bin/python" -c 'import ctypes.util, sys; sys.exit(ctypes.util.find_library("OSMesa") is None)'; }
has_osmesa && exit 0
if command -v apt-get >/dev/null 2>&1; then
    if [ "$(id -u)" = 0 ]; then as_root=
    elif command -v sudo >/dev/null 2>&1 && sudo -n true 2>/dev/null; then as_root='sudo -n'
    else as_root=none
    fi
    if [ "$as_root" != none ]; then
        echo "setup: installing libosmesa6"
        $as_root sh -c 'apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq libosmesa6' >/dev/null || true
    fi
fi
has_osmesa || echo "setup: pictures need OSMesa, which is not installed; install it with: sudo apt-get install libosmesa6" >&2
