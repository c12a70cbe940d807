# A thin front for CMake's presets.
#   make         configure and build (build/pags)
#   make setup   install what is missing (Debian; elsewhere says what is needed)
#   make demo    set up, build, and record, train and render a street of our own making
#   make check   set up, build, run all tests
#   make bench   run the benchmarks on the demo's scene: roofline, stages, speed against error
#   make install install program, library, headers and Python module below PREFIX (/usr/local)
#   make clean   remove build/

JOBS ?= $(shell nproc)
PREFIX ?= /usr/local

all:
	cmake --preset release
	cmake --build --preset release --parallel $(JOBS)

setup:
	sh scripts/setup.sh

demo: setup
	$(MAKE) all
	sh scripts/demo.sh

check: setup
	$(MAKE) all
	ctest --preset release --parallel $(JOBS)

bench: build/demo/scene/scene.json
	build/pags bench roofline build/demo/scene
	build/pags bench stages build/demo/scene
	build/pags bench error build/demo/scene --downscale 2

build/demo/scene/scene.json:
	$(MAKE) demo

install: all
	cmake --install build --prefix $(PREFIX)

clean:
	rm -rf build

.PHONY: all setup demo check bench install clean
