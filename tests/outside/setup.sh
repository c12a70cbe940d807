#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Installs third-party programs that read files of pags export, for the tests: node modules and usd-core, below this
# folder. Never fails, as only these tests need them.
set -u
cd "$(dirname "$0")" || exit 1

if ! cmp -s package-lock.json node_modules/.of; then
  if command -v npm >/dev/null; then
    echo "setup: installing tests/outside/node_modules"
    if npm ci --no-audit --no-fund --loglevel=error; then
      cp package-lock.json node_modules/.of
    else
      echo "setup: could not install tests/outside/node_modules; going on without these readers"
    fi
  else
    echo "setup: no npm here; going on without gltf-validator and splat-transform in the tests"
  fi
fi

sh ../../scripts/venv.sh "$PWD" || echo "setup: could not make tests/outside/.venv; going on without usd-core in the tests"
exit 0
