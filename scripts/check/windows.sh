#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Program and tests for Windows, under wine, compared with the program for Linux bit by bit.
# Tests of kernels run once per instruction set, those of the add-on in Blender's module for Windows; tests/windows.py compares the programs.
# WINEPREFIX is wine's own folder.
. "${0%/*}/common.sh"
for tool in wine ctest python3; do
  if ! command -v $tool >/dev/null; then
    echo "check-windows: no $tool; on Debian: apt-get install wine wine64 cmake python3" >&2
    exit 1
  fi
done
build
build="build-cross/windows-x64"
export WINEDEBUG="${WINEDEBUG:--all}"
python=""
if sh scripts/setup_windows.sh; then
  python=$(cd "${PAGS_CROSS:-$HOME/.cache/pags-cross}" && pwd)/windows-python/python.exe
else
  echo "check-windows: the add-on's tests are left out: there is no Python for Windows (it takes pip and, of Debian, maven)"
fi
sh scripts/cross.sh windows-x64 -DPAGS_TESTS=ON -DCMAKE_CROSSCOMPILING_EMULATOR=wine -DPAGS_WINDOWS_PYTHON="$python"
cmake --build "$build" --parallel "$jobs" --target tests

# Makes the prefix, which takes a while, before a test's time runs, and keeps wine's own programs running: where a test starts them they hold
# its output open, and ctest waits for them.
tail -f /dev/null --pid=$$ | wine cmd /c more >/dev/null 2>&1 &
wine cmd /c exit 0 </dev/null >/dev/null 2>&1

failed=0
# Without checks of the sources, which do not depend on the system. A test may have two names: for the best kernels and for a set of kernels.
ctest --test-dir "$build" --parallel "$jobs" --output-on-failure -E '^(style|figures|docs|tools\.|outside\.)' || failed=1
grep -h '\.\.\. skipped \|^skipped: ' "$build/Testing/Temporary/LastTest.log" | sort -u || true
grep -v '^#' tests/windows_lacks.txt | sed 's/^/left out: /'
python3 -B tests/windows.py "$build/pags.exe" build/pags || failed=1

# The wheel, where make packages has made one: its program as pip installs it, and its module in that Python.
for wheel in dist/pags-*win_amd64.whl; do
  [ -e "$wheel" ] || continue
  rm -rf "$build/installed"
  python3 -m pip install -q --disable-pip-version-check --no-deps --no-index --platform win_amd64 --python-version 3.11 --only-binary :all: --target "$build/installed" "$wheel"
  mkdir "$build/installed/bin/tests"
  cp "$build/tests/windows_interrupt.exe" "$build/installed/bin/tests/"
  python3 -B tests/windows.py "$build/installed/bin/pags.exe" build/pags || failed=1
  if [ -n "$python" ]; then # through a pipe: under wine, Python can't begin with a file as its output
    said=$(PYTHONPATH=$(winepath -w "$build/installed") wine "$python" -B -c "import pags; print('the module of the wheel:', pags.__version__)" </dev/null 2>&1) || failed=1
    echo "$said"
  fi
done
[ $failed = 0 ] && echo "check-windows: all passed" || echo "check-windows: there are failures" >&2
exit $failed
