# setup run test lint gen bench reproduce: each does first what it needs, and nothing twice on an unchanged tree.
#   make run ARGS='--format ndjson'    arguments for 'fltea run'
#   make test ARGS='-k timebase'       arguments for pytest
#   make reproduce ARGS='--seeds 100'  arguments for 'fltea reproduce'

.PHONY: setup run test lint gen bench reproduce clean
.DELETE_ON_ERROR:

PY := .venv/bin/python
NATIVE := pyproject.toml constraints.txt tools/setup.sh host/native/CMakeLists.txt \
          $(wildcard host/native/*.cpp host/native/*.hpp) $(addprefix firmware/core/,cobs.h crc32.h frame.h messages.h)
CXX_FILES := $(wildcard host/native/*.cpp host/native/*.hpp firmware/core/*.h tests/firmware/*.cpp tests/firmware/*.h \
                       tests/native/*.cpp tests/native/*.h)
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
	@$(PY) tools/gen_memory_constants.py --check
	@$(PY) tools/make_golden.py --check

gen: .venv/.dev
	@$(PY) tools/gen_protocol.py
	@$(PY) tools/make_vectors.py
	@$(PY) tools/gen_memory_constants.py
	@$(PY) tools/make_golden.py

bench: .venv/.dev
	@$(PY) -m tools.bench $(ARGS)

# The paper's tables and figures, in build/reproduce.
reproduce: .venv/.dev
	@$(PY) -m fltea reproduce --out build/reproduce $(ARGS)

clean:
	rm -rf .venv build
