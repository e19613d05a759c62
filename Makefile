# `make help` lists the targets. Each first does what it needs, and nothing twice on an unchanged tree.
#   make run ARGS='--format ndjson'             arguments for 'fltea run'
#   make near ARGS='--since HEAD~3'             what is near a change, and since when: tools/near.py
#   make test ARGS='-k timebase'                arguments for pytest
#   make reproduce ARGS='--seeds 100'           arguments for 'fltea reproduce'
#   make validate ARGS='gallery --quick'        which part, and its arguments
#   make flash PORT=/dev/ttyACM0                the board's programming port, if it is not the only one
#   make emulate ARGS='--virtual 20 --json'     arguments for the emulated Due

.PHONY: help setup hashes run near test test-slow test-all test-long test-prepared lint lint-types lint-style lint-cppcheck lint-tidy lint-generated gen bench validate reproduce \
        firmware flash emulate mutants faults docs man dist clean install-service install-udev uninstall-service
.DELETE_ON_ERROR:

PY := .venv/bin/python
NATIVE := pyproject.toml constraints.txt $(wildcard tools/hashes/*.txt) tools/setup.sh host/native/CMakeLists.txt \
          host/native/source_hash.py $(wildcard host/native/*.cpp host/native/*.hpp firmware/core/engine/*.hpp) $(addprefix firmware/core/,cobs.h crc32.h frame.h messages.h)
CXX_FILES := $(wildcard host/native/*.cpp host/native/*.hpp firmware/core/*.h firmware/core/*.cpp firmware/core/engine/*.hpp firmware/due/*.cpp firmware/due/*.h \
                       firmware/arduino/fltea/*.h tests/firmware/*.cpp tests/firmware/*.h tests/firmware/arduino_stub/*.cpp \
                       tests/firmware/arduino_stub/*.h tests/due_emulator/*.cpp tests/native/*.cpp tests/native/*.h tools/due_emulator/*.?pp)
PY_DIRS := host tools tests

help:  ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-18s %s\n", $$1, $$2 }' Makefile

setup: .venv/.dev  ## what is missing: system packages, .venv, the native module

.venv/.run: $(NATIVE)
	@tools/setup.sh run
	@touch $@

.venv/.dev: $(NATIVE)
	@FLTEA_WERROR=ON tools/setup.sh dev
	@touch .venv/.run $@

# After a change of constraints.txt or of the dependencies in pyproject.toml: the hashes of what set-up installs.
hashes:  ## after a change of dependencies: the hashes of what set-up installs
	@tools/hashes.sh

run: .venv/.run  ## the daemon on a Due in software; ARGS: options of fltea run
	@$(PY) -m tools.demo

# Hundreds of tests start the program, so its modules are compiled once, whatever the environment says. A library of
# linear algebra that spins on every core would only take them from the other tests. Not three at a time: some tests
# are of programs that have to keep up with a line.
TESTS := PYTHONDONTWRITEBYTECODE= OPENBLAS_NUM_THREADS=1 $(PY) -m pytest
TWO_WORKERS := -n 2 --dist loadfile --no-loadscope-reorder

# Style, types and generated files of what has changed, up to the first failure, and the tests that mirror it, the nearest
# first: no test begins after 75 s. On two idle cores that takes two minutes at most, on busy ones the types take longer.
near: .venv/.dev  ## two minutes: style, types and tests near what has changed; ARGS: of tools/near.py
	@$(PY) -m tools.near $(ARGS)

# The mark `slow` keeps a test out of the first tier, the mark `long` out of the second as well (tests/README.md).
test: .venv/.dev  ## the first tier of tests, 6 minutes; ARGS: of pytest
	@$(TESTS) $(TWO_WORKERS) -m "not slow" $(ARGS)

test-slow: .venv/.dev  ## the second tier, 8 minutes
	@$(TESTS) $(TWO_WORKERS) -m "slow and not long" $(ARGS)

test-all: test  ## both tiers
	@$(MAKE) --no-print-directory test-slow

test-long: .venv/.dev  ## the third tier, before a release: what repeats a proof many times over
	@$(TESTS) $(TWO_WORKERS) -m long $(ARGS)

# What the tests need compiled, made while something else takes the other core: .ci/run.
test-prepared: .venv/.dev
	@$(TESTS) --collect-only -q >/dev/null
	@$(MAKE) --no-print-directory -C tests/native BUILD=$(CURDIR)/build/tests-native prepared >/dev/null

# Parts that need nothing of each other; `make --jobs=2 --output-sync lint` runs two at a time.
LINT := lint-types lint-style lint-cppcheck lint-tidy lint-generated
lint: $(LINT)  ## style, types, C++ checks, and whether generated files are up to date
$(LINT): .venv/.dev

lint-types:
	@$(PY) -m mypy

lint-style:
	@$(PY) -m ruff format --check $(PY_DIRS)
	@$(PY) -m ruff check $(PY_DIRS)
	@$(PY) -m tools.findings_form
	@.venv/bin/clang-format --dry-run -Werror $(CXX_FILES)

lint-cppcheck:
	@cppcheck --quiet --std=c++11 --language=c++ --enable=warning,style,performance,portability --error-exitcode=1 \
		--suppress=useStlAlgorithm --suppress=unusedStructMember -I firmware/core firmware/due firmware/arduino/fltea tests/firmware/strict.cpp

lint-tidy:
	@$(MAKE) --no-print-directory -C tests/firmware tidy

lint-generated:
	@$(PY) -m tools.generated --check

gen: .venv/.dev  ## write the generated files
	@$(PY) -m tools.generated

# Both ports: the bare-metal image (committed), and the Arduino sketch against the stub of its libraries.
firmware: .venv/.dev  ## the Due's image and the Arduino sketch
	@$(PY) -m tools.generated build_id
	@$(PY) -m tools.build_firmware
	@$(PY) -m pytest -q tests/firmware/test_image.py tests/firmware/test_arduino.py

flash: .venv/.run  ## write the image to the board; PORT: its programming port
	@$(PY) -m fltea flash $(if $(PORT),--port $(PORT)) $(ARGS)

emulate: .venv/.run  ## the Due in software; ARGS: of tools/due_emulator
	@$(PY) -m tools.due_emulator $(ARGS)

# Single bugs put into the firmware, one at a time, and what notices each; of the host, 40 random changes:
# make mutants ARGS='--host 40 --seed 1'
mutants: .venv/.dev  ## single bugs put in on purpose, and the test that notices each; ARGS: --host 40 --seed 1
	@$(PY) -m tools.mutants $(ARGS)

faults: .venv/.dev  ## every fault of board, daemon, fleet, ingest and cluster, in build/faults.md, 8 minutes
	@$(PY) -m tools.faults $(ARGS)

# The program's modules are compiled once, whatever the environment says: else each start takes 0.3 s more than that of a
# program that is installed, and `--against` compares the two.
bench: .venv/.dev  ## speed, side by side in one run; ARGS: which part
	@PYTHONDONTWRITEBYTECODE= $(PY) -m tools.bench $(ARGS)

# What verdicts, fits and filters are worth on noises whose truth is known, in build/validation. One thread a process for
# linear algebra: its others only spin, and a run takes three times as long.
validate: .venv/.dev  ## what verdicts, fits and filters are worth on known noises; ARGS: which part
	@OPENBLAS_NUM_THREADS=1 $(PY) -m tools.validation $(ARGS)

# The paper's tables and figures, in build/reproduce.
reproduce: .venv/.dev  ## the paper's tables and figures, in build/reproduce
	@$(PY) -m fltea reproduce --out build/reproduce $(ARGS)

# The site, in build/site; every link in it is checked, but for those to other sites.
docs: .venv/.dev  ## the site, in build/site
	@NO_MKDOCS_2_WARNING=1 $(PY) -m mkdocs build --strict --config-file host/mkdocs.yml

# Man pages in build/man, completion for bash, zsh and fish in build/completions.
man: .venv/.run  ## man pages and shell completion, in build
	@$(PY) -m tools.man_pages

# What is published, in build/dist: sdist, wheels and Debian packages for x86-64 and aarch64, each tried, and how long that took.
# What it needs: tools/dist/RELEASE.md.
dist: .venv/.dev  ## sdist, wheels and Debian packages, in build/dist
	@begin=$$(date +%s); for step in wheels try deb try_deb try_container; do tools/dist/$$step.sh || exit; done; \
		echo "dist: done in $$(($$(date +%s) - begin)) s" >&2

# As root. PREFIX=/opt/fltea: where the program goes; DESTDIR=FOLDER: only write the files, into that tree.
install-service:  ## as root: the program as a service; PREFIX, DESTDIR
	@tools/deploy/service.sh install

install-udev:  ## as root: the rule that lets users open the board
	@tools/deploy/service.sh udev

uninstall-service:  ## as root: take the service away
	@tools/deploy/service.sh uninstall

clean:  ## remove .venv and build
	rm -rf .venv build
