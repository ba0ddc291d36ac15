# make demo   install, then find objects and grasps in the bundled capture
# make test   install, then run the tests
# make fuzz   10,000 strange calls, each of which must be answered or refused in one line
# make check  formatting, lint and types
# make docs   the docs site, in site/; broken links and anchors fail
# make guides every block of code of the guides, as it is written, small; slow
PYTHON ?= python3
BIN := .venv/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt

.PHONY: demo test fuzz check docs guides format clean

demo: .venv/installed
	$(BIN)/icgnet demo

test: .venv/installed-dev
	$(BIN)/python -m pytest -n auto --dist worksteal

fuzz: .venv/installed-dev
	PYTHONPATH=tests OMP_NUM_THREADS=1 $(BIN)/python -m fuzz.calls

check: .venv/installed-dev
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/pyright --pythonpath $(BIN)/python

docs: .venv/installed-docs
	$(BIN)/python -m mkdocs build --strict

guides: .venv/installed-dev
	OMP_NUM_THREADS=1 $(BIN)/python scripts/run_guides.py

format: .venv/installed-dev
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

clean:
	rm -rf .venv site demo_output demo_output_table

.venv/bin/python:
	$(PYTHON) -c 'import sys; assert sys.version_info >= (3, 11), "icgnet needs Python 3.11 or newer, this is " + sys.version'
	$(PYTHON) -m venv .venv

.venv/installed: .venv/bin/python pyproject.toml constraints.txt
	$(PIP) -e .
	touch $@

.venv/installed-dev: .venv/installed
	$(PIP) -e ".[dev]"
	touch $@

.venv/installed-docs: .venv/installed
	$(PIP) -e ".[docs]"
	touch $@
