# SPDX-License-Identifier: Apache-2.0
# Short names for CMake's presets and the scripts.
#   make         configure and build (build/pags)
#   make setup   install what is missing (Debian; elsewhere says what is needed)
#   make demo    set up, build, then make a synthetic street, train, render, evaluate and export it
#   make check   set up, build, run all tests
#   make fuzz    every reader under libFuzzer (clang): MINUTES=1 of CPU time a target, LONG_MINUTES for five of them (docs/reliability.md)
#   make fuzz-long  the same at length: 5 minutes, and 30
#   make sanitize  the whole suite under the address, undefined-behaviour and thread sanitizers (hours; docs/reliability.md)
#   make valgrind  the program's way from a data set to exported files under valgrind (docs/reliability.md)
#   make bench   run the benchmarks on the demo's scene: roofline, stages, speed against error
#   make addon   the Blender add-on as build/pags-blender-*.zip, validated where a Blender of 4.2 or newer is found
#   make setup-cross  what make cross needs, into PAGS_CROSS (~/.cache/pags-cross): a compiler and the sources of libraries, checked by hash
#   make cross TARGET=NAME  program, library, Python module and add-on for another system, into build-cross/NAME (docs/porting.md); NAME is
#                windows-x64, macos-arm64, macos-x64, linux-x64-glibc2.17 or linux-arm64
#   make packages  wheels, archives and add-ons of all cross builds, and the Debian packages, into dist/; TARGETS="NAME ...": those of these alone;
#                and of the add-ons there one zip for Blender 3.4 to 4.1 on all of their systems
#   make container  the program of the Linux archive as a container image in dist/ (docs/release.md)
#   make check-wheel  the wheel for Linux, installed into a fresh environment, beside build/pags, bit by bit (OLD=FOLDER: in an older Debian, too);
#                the wheel for 64-bit ARM in the same way under an emulator, and what those for macOS promise, as far as they are in dist/
#   make check-reproducible TARGETS="NAME ..."  build their packages again in another folder, at another time: the same bytes (an hour a target)
#   make deb     the Debian packages of the commit that is checked out, into dist/, checked by lintian (docs/release.md)
#   make check-deb  install these into a fresh Debian 12, use them there, in Blender, too, and remove them (mmdebstrap; as root; a quarter of an hour)
#   make check-arm64  the engine's unit tests and a short training for 64-bit ARM, under an emulator; beside the same of x86-64, bit by bit
#   make check-windows  tests and program of the build for Windows, under wine; beside the program of Linux, bit by bit
#   make check-scaling  the predictions of pags-bench scaling beside the clock, on two threads of a quiet machine
#   make check-cluster  ranks of mpirun killed at ten random moments, stopped, out of memory, with a full disk, behind a link that goes down; trainings on 1 to 4 ranks, bit by bit
#   make check-interrupts  every signal at ten random moments of training, import, export and merge; two and four processes at one folder, 50 times; 200
#                ordinary runs one after the other (twenty minutes)
#   make check-viewers      splat files of a scene with a least alpha, drawn by Babylon.js and Spark in Chromium beside pags (SCENE=FOLDER: another scene)
#   make check-scene-html  scene.html in a headless Chromium, without a network, beside pags render (SCENE=FOLDER: another scene)
#   make check-tools  what pags export writes for other tools, in Babylon.js, Godot 4 and OpenUSD, of SCENE=FOLDER, by default the demo's, with pictures
#                into build/tools; GODOT=PROGRAM, else scripts/setup_godot.sh fetches one (0.7 GB)
#   make check-view  pags view, train --view and pages of pags report in a headless Chromium, and ten thousand hostile requests (two minutes)
#   make check-recordings  imported recordings beside what the sources' own Python packages read of them; raw trees with damaged files, damaged tables (five minutes)
#   make check-photos  photographs and a video without cameras, by COLMAP, as far as a trained scene (apt-get install colmap ffmpeg; five minutes)
#   make check-blender      the add-on's tests in Debian's Blender; part of make check
#   make check-obey  local view, borders, clipping and the tool that selects in a window of it
#   make check-inspect  the panels Inspect, Recording and Measure in a window of it, the sidebar and the legends
#   make check-blender-new  the same in a newer one: BLENDER_NEW=PROGRAM, a Blender or a Python with the module bpy
#   make check-blender-window-new  the window's tests in a newer Blender with a window (scripts/setup_blender_new.sh makes one), and its validation of the zip
#   make bench-blender SCENE=FOLDER  what the add-on takes: importing, memory, the viewport in a window under Xvfb
#   make guide   does what docs/blender-guide.md says, in a window, and takes its pictures, of the demo's street
#   make same-bits REFERENCE=COMMIT  build that commit too and compare, bit by bit, what both programs write (OPTIONS=--quick: a minute)
#   make figures REFERENCE=COMMIT  count what tests/figures.py counts of the code and the manual, at that commit and now
#   make docs    write the options and fields of pags train into docs/command-line.md
#   make format  format every C and C++ file
#   make install install program, library, headers and Python module below PREFIX (/usr/local)
#   make clean   remove build/

JOBS ?= $(shell nproc)
PREFIX ?= /usr/local
BLENDER_NEW ?=
SCENE ?= build/demo/scene
MINUTES ?= 1
LONG_MINUTES ?= $(MINUTES)
TARGETS ?=
TARGET ?=
OLD ?=
REFERENCE ?= HEAD
OPTIONS ?=

# Checks that take hours, or programs that make setup doesn't install.
NOT_CHECKED := check-reproducible check-wheel check-arm64 check-blender-new check-blender-window-new check-cluster check-deb check-inspect check-interrupts check-obey check-photos check-recordings check-scaling check-scene-html check-tools check-view check-viewers check-windows fuzz guide sanitize valgrind

all:
	cmake --preset release
	cmake --build --preset release --parallel $(JOBS)

setup:
	sh scripts/setup.sh
	sh scripts/venv.sh scripts
	for tool in segment recordings; do sh scripts/venv.sh tools/$$tool || echo "setup: going on without tools/$$tool and its tests"; done
	sh tests/outside/setup.sh

demo: setup
	$(MAKE) all
	sh scripts/demo.sh

check: setup
	$(MAKE) all
	@echo "check: not run by it:$(NOT_CHECKED:%= make %)"
	ctest --preset release --parallel $(JOBS)

fuzz:
	cmake --preset fuzz
	cmake --build --preset fuzz --parallel $(JOBS) --target fuzz_targets
	python3 scripts/fuzz.py --minutes $(MINUTES) --long-minutes $(LONG_MINUTES) --json build-fuzz/fuzz.json build-fuzz $(TARGETS)

fuzz-long:
	$(MAKE) fuzz MINUTES=5 LONG_MINUTES=30

sanitize:
	for preset in asan-ubsan tsan; do \
	  cmake --preset $$preset && cmake --build --preset $$preset --parallel $(JOBS) && ctest --preset $$preset || exit 1; done

valgrind: all
	sh tests/valgrind.sh build/pags

bench: build/demo/scene/scene.json
	build/pags-bench roofline build/demo/scene
	build/pags-bench stages build/demo/scene
	build/pags-bench error build/demo/scene --downscale 2

build/demo/scene/scene.json:
	$(MAKE) demo

addon: all
	sh scripts/validate_addon.sh "$(BLENDER_NEW)"

check-blender: addon
	ctest --preset release -R '^(addon|blender)\.'

check-obey: addon
	python3 tests/addon/run_blender.py gui_obey.py "$(CURDIR)/build/pags" "$(CURDIR)"/build/pags-blender-*.zip

check-inspect: addon
	for script in inspect labels look; do python3 tests/addon/run_blender.py gui_$$script.py "$(CURDIR)/build/pags" \
	  "$(CURDIR)"/build/pags-blender-*.zip || exit 1; done

check-blender-new: addon
	cmake -S . -B build -DPAGS_BLENDER_NEW="$(BLENDER_NEW)"
	ctest --preset release -R '^blender_new\.'

check-blender-window-new: addon build/demo/scene/scene.json
	@test -n "$(BLENDER_NEW)" || { echo "name a Blender by BLENDER_NEW=PROGRAM; scripts/setup_blender_new.sh makes one of Debian's packages"; exit 1; }
	"$(BLENDER_NEW)" --command extension validate "$(CURDIR)"/build/pags-blender-*.zip
	for script in viewport files jobs labels obey inspect look guide; do echo "gui_$$script.py"; PAGS_GUIDE_SCENE="$(CURDIR)/build/demo/scene" python3 tests/addon/run_blender.py gui_$$script.py \
	  "$(CURDIR)/build/addon/pags_blender/bin/pags" "$(CURDIR)"/build/pags-blender-*.zip "$(BLENDER_NEW)" || exit 1; done
	python3 -B tests/addon/test_guide.py build/pags build/pags-blender-*.zip "$(BLENDER_NEW)"

bench-blender: addon
	for script in blender_import gui_blender; do PAGS_BENCH_SCENE="$(abspath $(SCENE))" python3 tests/addon/run_blender.py \
	  "$(CURDIR)/benchmarks/$$script.py" "$(CURDIR)/build/pags" "$(CURDIR)"/build/pags-blender-*.zip || exit 1; done

guide: addon build/demo/scene/scene.json
	PAGS_GUIDE_SCENE="$(CURDIR)/build/demo/scene" PAGS_GUIDE_IMAGES="$(CURDIR)/docs/images" \
	  python3 tests/addon/run_blender.py gui_guide.py "$(CURDIR)/build/pags" "$(CURDIR)"/build/pags-blender-*.zip

setup-cross:
	sh scripts/setup_cross.sh

cross:
	JOBS=$(JOBS) sh scripts/cross.sh $(TARGET)

packages: $(if $(TARGETS),,deb)
	for target in $(or $(TARGETS),windows-x64 macos-arm64 macos-x64 linux-x64-glibc2.17 linux-arm64); do \
	  JOBS=$(JOBS) sh scripts/cross.sh $$target && python3 -B scripts/package_cross.py build-cross/$$target dist || exit 1; done
	python3 -B scripts/package_addon.py dist

container:
	sh scripts/container.sh

check-wheel: all
	PAGS_OLD_ROOT="$(OLD)" python3 -B tests/wheel.py dist/pags-*manylinux_2_17_x86_64*.whl build/pags
	python3 -B tests/foreign_wheels.py build/pags $(wildcard dist/pags-*manylinux_2_17_aarch64*.whl dist/pags-*macosx*.whl)

check-reproducible:
	sh scripts/check_reproducible.sh $(TARGETS)

deb:
	JOBS=$(JOBS) sh scripts/package_deb.sh

check-deb:
	@ls dist/pags_*.deb >/dev/null 2>&1 || $(MAKE) deb
	sh scripts/check_deb.sh

check-arm64:
	JOBS=$(JOBS) sh tests/check_arm64.sh

check-windows: all
	JOBS=$(JOBS) sh scripts/check_windows.sh

check-scaling: all
	cmake --build --preset release --target check_scaling
	build/tests/check_scaling

check-recordings: all
	sh tests/recordings/setup.sh
	tests/recordings/.venv/bin/python -B tests/recordings/check_sources.py build/pags
	tests/recordings/.venv/bin/python -B tests/recordings/check_blind.py build/pags
	tests/recordings/.venv/bin/python -B tests/recordings/check_damage.py build/pags
	for table in pickle parquet feather; do tests/recordings/.venv/bin/python -B tests/recordings/fuzz_tables.py $$table 60 || exit 1; done
	TOOL_PYTHON=own tests/recordings/.venv/bin/python -B tests/recordings/test_ncore.py build/pags

check-photos: all
	python3 -B tests/recordings/check_photos.py build/pags

check-cluster: all
	PAGS_KILLS=10 python3 -B tests/cluster/test_ranks.py build/pags Ranks.test_killed Ranks.test_stopped
	PAGS_KILLS=10 python3 -B tests/cluster/test_failures.py build/pags build/tests/cluster/libfailing_malloc.so
	build/pags synth street -q --overwrite -o build/check-cluster/street --size 192x108 --frames 12 --cameras 1 --no-shifts
	python3 -B benchmarks/cluster_bits.py build/pags build/check-cluster/street build/check-cluster --iterations 480 --set resolution_floor=32 --max-gaussians 6000

check-interrupts: all
	PAGS_MOMENTS=10 PAGS_TOGETHER=50 PAGS_ORDINARY=200 python3 -B tests/faults/test_interrupts.py build/pags

check-viewers: all
	python3 -B tests/outside/viewers.py build/pags build/viewers $(if $(filter command line,$(origin SCENE)),"$(abspath $(SCENE))")

check-scene-html: all
	python3 -B tests/outside/scene_html.py build/pags build/scene-html $(if $(filter command line,$(origin SCENE)),"$(abspath $(SCENE))")

check-view: all
	python3 -B tests/outside/view.py build/pags build/view
	python3 -B tests/outside/report.py build/pags build/view
	python3 -B tests/outside/train_view.py build/pags build/view
	PAGS_VIEW_HOSTILE=10000 python3 -B tests/cli/test_view.py build/pags Hostile

check-tools: all $(SCENE)/scene.json
	mkdir -p build/tools
	GODOT="$${GODOT:-$$(sh scripts/setup_godot.sh)}" python3 -B tests/outside/test_tools.py build/pags "$(abspath $(SCENE))" "$(CURDIR)/build/tools"

same-bits: all
	python3 tests/same_bits.py --reference "$(REFERENCE)" $(OPTIONS)

figures:
	python3 tests/figures.py --reference "$(REFERENCE)" $(OPTIONS)

docs: all
	python3 scripts/options_page.py build/pags

format:
	sh scripts/format.sh

install: all
	cmake --install build --prefix $(PREFIX)

clean:
	rm -rf build

.PHONY: all setup demo check fuzz fuzz-long sanitize valgrind bench addon check-blender check-inspect check-obey check-blender-new check-blender-window-new bench-blender guide setup-cross cross check-arm64 check-windows check-scaling check-scene-html check-tools check-view check-viewers check-recordings check-photos same-bits figures docs install clean deb check-deb packages container check-wheel check-reproducible check-cluster check-interrupts
