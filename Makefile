# Everything runs in a virtual environment of its own, .venv, made on first use.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check

.PHONY: help compare test lint style types imports tests bench docs notebooks evidence evidence-check json-schemas lock clean

help:
	@echo "make compare  set up, run the default comparison, write results/default/report.html"
	@echo "make test     set up, lint, type-check, run every test"
	@echo "make bench    set up, measure speed against named peers"
	@echo "make docs     set up, build the documentation: docs/_build/index.html"
	@echo "make evidence  set up, run or complete every study behind the documentation (hours; resumable)"
	@echo "make notebooks  set up, open the lessons in JupyterLab"

compare: $(VENV)/installed
	$(BIN)/causal-openlock compare default --out results/default

# Side by side, each to its end; that packages use only what they stand on is one of the tests.
test: $(VENV)/installed-test
	@$(MAKE) --no-print-directory --keep-going -j3 style types tests

lint: style types imports

style: $(VENV)/installed-test
	@$(BIN)/ruff format --check . && $(BIN)/ruff check .

types: $(VENV)/installed-test
	@$(BIN)/mypy

imports: $(VENV)/installed-test
	@$(BIN)/lint-imports

tests: $(VENV)/installed-test
	@$(BIN)/python -m pytest -n auto -q --durations=10

bench: $(VENV)/installed-test
	$(BIN)/python benchmarks/run.py

# Warnings are errors; nothing is loaded from the network.
docs: $(VENV)/installed-test
	$(BIN)/python -m sphinx -W --keep-going -q docs docs/_build

# Every study whose numbers the documentation has; `causal-openlock evidence` lists them with the
# time that each takes. It can be stopped, and goes on.
evidence: $(VENV)/installed
	$(BIN)/causal-openlock evidence --all

# That all numbers and verdicts follow from what is stored: seconds, and one of the tests.
evidence-check: $(VENV)/installed
	$(BIN)/causal-openlock evidence --check

# The lessons, to run and to change; it goes on until Ctrl-C.
notebooks: $(VENV)/installed-notebooks
	$(BIN)/python -m jupyterlab notebooks

# The JSON Schemas that editors use, made anew from the models.
json-schemas: $(VENV)/installed
	$(BIN)/python -m causal_openlock.experiment.json_schemas

# The exact versions of everything, from a fresh environment.
lock:
	rm -rf $(VENV)-lock
	$(PYTHON) -m venv $(VENV)-lock
	$(VENV)-lock/bin/python -m pip install -q torch==2.13.0
	$(VENV)-lock/bin/python -m pip install -q -e ".[test,notebooks]"
	(sed -n '/^#/p' constraints.txt; $(VENV)-lock/bin/python -m pip freeze --exclude-editable | sed 's/+cpu$$//') > constraints.new
	mv constraints.new constraints.txt
	rm -rf $(VENV)-lock

clean:
	rm -rf $(VENV) build dist docs/_build .pytest_cache .mypy_cache .ruff_cache .hypothesis

$(BIN)/python:
	$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or newer is needed, and this is " + sys.version.split()[0] + "; pass PYTHON=...") if sys.version_info < (3, 11) else None'
	$(PYTHON) -m venv $(VENV)

$(VENV)/installed: $(BIN)/python pyproject.toml constraints.txt
	$(PIP) install -q -c constraints.txt -e .
	@touch $@

$(VENV)/installed-test: $(BIN)/python pyproject.toml constraints.txt
	$(PIP) install -q -c constraints.txt -e ".[test]"
	@touch $@ $(VENV)/installed

$(VENV)/installed-notebooks: $(BIN)/python pyproject.toml constraints.txt
	$(PIP) install -q -c constraints.txt -e ".[notebooks]"
	@touch $@ $(VENV)/installed
