# Two commands do everything from nothing: `make demo` runs the main job, `make test` the tests.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: demo test lowest check docs bench clean

demo: $(VENV)/.ready
	$(BIN)/robot-retarget demo --out demo

test: $(VENV)/.ready
	$(BIN)/python -m pytest -n 2 --dist loadfile -rs

lowest:  # a solve with the oldest versions that pyproject.toml accepts
	$(PYTHON) -m venv --clear .lowest
	$(PYTHON) scripts/tools/lowest_versions.py > .lowest/versions.txt
	.lowest/bin/python -m pip install --quiet --constraint .lowest/versions.txt .
	.lowest/bin/robot-retarget solve samples/wave.bvh --robot op3 -o .lowest/wave.npz

check: $(VENV)/.ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright

$(VENV)/.ready: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --upgrade pip
	$(BIN)/python -m pip install --editable '.[dev]'
	touch $@

bench: $(VENV)/.ready
	$(BIN)/python scripts/bench/write_performance.py

docs: $(VENV)/.ready
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet

clean:
	rm -rf $(VENV) .lowest demo dist site
