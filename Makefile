# Two commands do everything from nothing: `make demo` runs the main job, `make test` the tests.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Tests wait for servos and browsers a third of their time: three fill two cores.
WORKERS ?= 3
# Modules are compiled once, and not by each of the processes that tests start.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: demo test lowest check docs bench clean

demo: $(VENV)/.demo
	$(BIN)/robot-retarget demo --out demo

test: $(VENV)/.ready
	$(BIN)/python -m pytest -n $(WORKERS) --dist loadfile -rs

lowest:  # a solve with the oldest versions that pyproject.toml accepts
	$(PYTHON) -m venv --clear .lowest
	$(PYTHON) scripts/tools/lowest_versions.py > .lowest/versions.txt
	.lowest/bin/python -m pip install --quiet --constraint .lowest/versions.txt .
	.lowest/bin/robot-retarget solve samples/wave.bvh --robot op3 -o .lowest/wave.npz

check: $(VENV)/.ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright

# What the demo needs; the tools of developers are twice as large.
$(VENV)/.demo: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --editable '.[plots,video,view]'
	touch $@

$(VENV)/.ready: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --editable '.[dev]'
	touch $(VENV)/.demo $@

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "Python 3.11 or newer is needed, and $(PYTHON) is $$($(PYTHON) --version 2>&1). Name another: make $(MAKECMDGOALS) PYTHON=python3.11"; exit 2; }
	$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); exit 2; }

bench: $(VENV)/.ready
	$(BIN)/python scripts/bench/write_performance.py

docs: $(VENV)/.ready
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet

clean:
	rm -rf $(VENV) .lowest demo dist site
