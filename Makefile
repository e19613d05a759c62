# setup run test lint gen bench: each does first what it needs, and nothing twice on an unchanged tree.
#   make run ARGS='--format ndjson'    arguments for 'fltea run'
#   make test ARGS='-k timebase'       arguments for pytest

.PHONY: setup run test lint gen bench clean
.DELETE_ON_ERROR:

PY := .venv/bin/python
NATIVE := pyproject.toml constraints.txt tools/setup.sh host/native/CMakeLists.txt \
          $(wildcard host/native/*.cpp host/native/*.hpp firmware/core/*.h)
CXX_FILES := $(wildcard host/native/*.cpp host/native/*.hpp firmware/core/*.h tests/firmware/*.cpp tests/firmware/*.h)
PY_DIRS := host tools tests

setup: .venv/.dev

.venv/.run: $(NATIVE)
	@tools/setup.sh run
	@touch $@

.venv/.dev: $(NATIVE)
	@FLTEA_WERROR=ON tools/setup.sh dev
	@touch .venv/.run $@

run: .venv/.run
	@$(PY) tools/demo.py

test: .venv/.dev
	@$(PY) -m pytest $(ARGS)

lint: .venv/.dev
	@$(PY) -m ruff format --check $(PY_DIRS)
	@$(PY) -m ruff check $(PY_DIRS)
	@$(PY) -m mypy
	@.venv/bin/clang-format --dry-run -Werror $(CXX_FILES)
	@$(PY) tools/gen_protocol.py --check
	@$(PY) tools/make_vectors.py --check

gen: .venv/.dev
	@$(PY) tools/gen_protocol.py
	@$(PY) tools/make_vectors.py

bench: .venv/.run
	@$(PY) -m tools.bench $(ARGS)

clean:
	rm -rf .venv build
