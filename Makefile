# SPDX-License-Identifier: Apache-2.0
# Short names for CMake's presets and the scripts: `make help` lists them. Variables, with their defaults:
#   JOBS=processors  PREFIX=/usr/local  SCENE=build/demo/scene  DATA=build/demo/data  BLENDER_NEW=  TARGET=, TARGETS=  MINUTES=1, LONG_MINUTES=  OLD=
#   REFERENCE=HEAD  OPTIONS=

JOBS ?= $(shell nproc)
PREFIX ?= /usr/local
REFERENCE ?= HEAD
OPTIONS ?=
export JOBS BLENDER_NEW SCENE TARGETS MINUTES LONG_MINUTES OLD GODOT TESTS PRESETS
scene := $(or $(SCENE),build/demo/scene)
addon_test = python3 tests/addon/run_blender.py $(1) "$(CURDIR)/build/pags" "$(CURDIR)"/build/pags-blender-*.zip

# Checks that take hours, or programs that make setup does not install: make check does not run them.
NOT_CHECKED := $(filter-out blender common,$(basename $(notdir $(wildcard scripts/check/*.sh))))

ifneq ($(shell command -v ninja),) # a build folder keeps the tool it was made for
export CMAKE_GENERATOR ?= Ninja
endif

all: ## Build pags, pags-bench, libpags.so, the Python module and the add-on's zip in build/ (no tests).
	cmake --preset release
	cmake --build --preset release --parallel $(JOBS)

help: ## Print this list.
	@sh scripts/help.sh $(firstword $(MAKEFILE_LIST))

setup-min: ## Install the packages for make and make quick (Debian; 0.4 GB) and the pinned formatters.
	sh scripts/setup.sh min
	sh scripts/venv.sh scripts || echo "setup: no formatters; make quick then skips the check of the format"

setup: ## Install everything that make check uses (Debian; 2.9 GB), with the Python and node packages of the tests.
	sh scripts/setup.sh
	sh scripts/venv.sh scripts
	sh scripts/venv.sh benchmarks || echo "setup: continuing without matplotlib, which plots of the benchmarks need"
	for tool in segment recordings; do sh scripts/venv.sh tools/$$tool || echo "setup: continuing without tools/$$tool and its tests"; done
	sh tests/outside/setup.sh
	python3 -B scripts/lpips_weights.py || echo "setup: continuing without LPIPS (docs/eval.md)"

setup-%: ## Install the tools of make cross (setup-cross), a newer Blender, Godot, or Python for Windows (scripts/setup_NAME.sh).
	sh scripts/setup_$(subst -,_,$*).sh

demo: ## Make a synthetic street, train, render, evaluate and export it (Debian: installs setup-min and Embree first).
	sh scripts/setup.sh demo
	python3 -B scripts/lpips_weights.py || echo "demo: continuing without LPIPS (docs/eval.md)"
	$(MAKE) all
	sh scripts/demo.sh

quick: all ## Check style, kernels and units: the first check of a change, below 90 s once built.
	cmake --build --preset release --parallel $(JOBS) --target quick_tests
	ctest --preset release --parallel $(JOBS) -L quick

check: setup ## Run all tests: a change must pass them.
	$(MAKE) all
	cmake --build --preset release --parallel $(JOBS) --target tests
	@echo "make check does not run: make $(NOT_CHECKED:%=check-%) guide"
	ctest --preset release --parallel $(JOBS)

check-%:
	@test -e scripts/check/$*.sh || { echo "make: no check-$*; make help lists the checks" >&2; exit 2; }
	sh scripts/check/$*.sh

curve: $(if $(SCENE),all,build/demo/scene/scene.json) ## Draw frame time against error of SCENE=FOLDER into build/curve.svg, .md and .json.
	python3 -B benchmarks/curve.py frame "$(scene)" -o build/curve

training-curve: $(if $(DATA),all,build/demo/scene/scene.json) ## Draw training time against error on DATA=FOLDER into build/training-curve.* (hours; resumes).
	python3 -B benchmarks/curve.py training "$(or $(DATA),build/demo/data)" -o build/training-curve

bench-blender: addon ## Measure import, memory and viewport of the add-on, for SCENE=FOLDER, in a window under Xvfb.
	for script in blender_import gui_blender; do PAGS_BENCH_SCENE="$(abspath $(scene))" $(call addon_test,"$(CURDIR)/benchmarks/$$script.py") || exit 1; done

build/demo/scene/scene.json:
	$(MAKE) demo

addon: all ## Validate the add-on's zip (build/pags-blender-*.zip) where a Blender of 4.2 or newer is found.
	sh scripts/validate_addon.sh "$(BLENDER_NEW)"

guide: addon build/demo/scene/scene.json ## Follow docs/blender-guide.md in a window of Blender and take its pictures.
	PAGS_GUIDE_SCENE="$(CURDIR)/build/demo/scene" PAGS_GUIDE_IMAGES="$(CURDIR)/docs/images" $(call addon_test,gui_guide.py)

cross: ## Build for another system, TARGET=NAME, into build-cross/NAME (docs/porting.md lists the names).
	sh scripts/cross.sh $(TARGET)

packages: $(if $(TARGETS),,deb) ## Make wheels, archives, add-ons and Debian packages in dist/ (TARGETS="NAME ...": of these systems).
	for target in $(or $(TARGETS),windows-x64 macos-arm64 macos-x64 linux-x64-glibc2.17 linux-arm64); do \
	  sh scripts/cross.sh $$target && python3 -B scripts/package_cross.py build-cross/$$target dist || exit 1; done
	python3 -B scripts/package_addon.py dist

deb: ## Make the Debian packages of the commit in dist/ and check them by lintian.
	sh scripts/package_deb.sh

container: ## Make a container image of the Linux archive in dist/ (docs/release.md).
	sh scripts/container.sh

same-bits: all ## Build REFERENCE=COMMIT and compare the outputs of both programs bit by bit (OPTIONS=--quick: a minute).
	python3 tests/same_bits.py --reference "$(REFERENCE)" $(OPTIONS)

figures: ## Count functions, lines, words and more at REFERENCE=COMMIT and now.
	python3 tests/figures.py --reference "$(REFERENCE)" $(OPTIONS)

docs: all ## Write the options and fields of pags train into docs/command-line.md.
	python3 scripts/options_page.py build/pags

format: ## Format the C, C++ and Python files, and check the format of all sources.
	sh scripts/format.sh

install: all ## Install program, library, headers and Python module below PREFIX=/usr/local.
	cmake --install build --prefix $(PREFIX)

clean: ## Remove build/.
	rm -rf build

# Old names.
bench: curve
fuzz sanitize valgrind: %: check-%
fuzz-long:
	$(MAKE) check-fuzz MINUTES=5 LONG_MINUTES=30

.PHONY: all help setup-min setup demo quick check curve training-curve bench-blender addon guide cross packages deb container same-bits figures docs format install clean bench fuzz sanitize valgrind fuzz-long
