#!/bin/sh
# Type-check the package as a user gets it: installed from its wheel, in a folder of its own.
set -eu
venv=$1
rm -rf build/types && mkdir -p build/types
"$venv/bin/python" -m pip install --quiet --no-deps --target build/types/site .
printf '{"extends": "../../pyproject.toml", "include": ["site/swimmer_mj"], "venvPath": "../..", "venv": ".venv", "extraPaths": ["site"]}\n' > build/types/pyrightconfig.json
"$venv/bin/pyright" --project build/types/pyrightconfig.json
