# Two commands do all the set-up: `make demo` and `make test`. They need Python >= 3.11 and make, nothing else.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed

# Test files are shared out over processes, each file to one, so that fixtures of a module are made once. The kernels
# are compiled before, or every process would compile the same; and OpenBLAS, given small products, works with one
# thread, since several only wait for each other.
WORKERS ?= --numprocesses auto --maxprocesses 4 --dist loadfile

.PHONY: demo test lint types benchmarks clean

demo: $(STAMP)
	$(BIN)/sixflow demo --output demo --overwrite

test: $(STAMP)
	$(BIN)/sixflow warm-up --quiet
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest $$($(BIN)/python -c 'import xdist' 2>/dev/null && echo $(WORKERS))

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports

types: $(STAMP)
	$(BIN)/mypy

benchmarks: $(STAMP)
	$(BIN)/python -m pip install --quiet --editable '.[benchmarks]'
	$(BIN)/python benchmarks/limit.py
	$(BIN)/python benchmarks/lowpass.py
	$(BIN)/python benchmarks/speed.py
	$(BIN)/python benchmarks/resolution.py
	$(BIN)/python benchmarks/robust.py
	$(BIN)/python benchmarks/operators.py
	$(BIN)/python benchmarks/search.py --quick
	$(BIN)/python benchmarks/fuzz.py
	$(BIN)/python benchmarks/scenes.py

$(STAMP): pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "sixflow needs Python 3.11 or newer: make PYTHON=python3.11")'
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	touch $(STAMP)

clean:
	rm -rf $(VENV) demo build dist
