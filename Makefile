# Everything runs in a virtual environment of its own, .venv, made on first use.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check

# What the targets on supply use: a resolver and an auditor, apart from what they look at.
TOOLS := .venv-tools
UV := $(TOOLS)/bin/uv
EXTRAS := --extra test --extra notebooks
# The first with which all of the locked set installs (soupsieve asks for it).
OLDEST := 3.11.5
PYTHONS := $(OLDEST) 3.12 3.13 3.14

.PHONY: help compare test test-fast lint style types imports tests bench scale soak identity fuzz docs notebooks lessons evidence \
        evidence-check json-schemas lock lock-hashes install-locked audit pythons test-minimum dist check-dist clean

help:
	@echo "make compare  set up, run the default comparison, write results/default/report.html"
	@echo "make test     set up, lint, type-check, run every test"
	@echo "make test-fast  set up, run the tests without a browser, a cluster or long play"
	@echo "make bench    set up, measure speed against named peers"
	@echo "make docs     set up, build the documentation: docs/_build/index.html"
	@echo "make evidence  set up, run or complete every study behind the documentation (hours; resumable)"
	@echo "make scale    set up, measure and draw how cost grows: docs/figures/scale.svg"
	@echo "make fuzz     set up, give 100,000 spoiled files to every reader (resumable: INPUTS=... FIRST=...)"
	@echo "make audit    set up a tool, ask for security advisories about the locked set"
	@echo "make notebooks  set up, open the lessons in JupyterLab"
	@echo "make lessons  set up, run the lessons and store what they put out: notebooks/"

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

# Whole files to each worker, in the order in which they are collected: slow ones first.
PYTEST := $(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder -q

tests: $(VENV)/installed-test
	@$(PYTEST) --durations=10

# A quick round while working: without long plays, browsers and clusters.
test-fast: $(VENV)/installed-test
	@$(PYTEST) -m "not slow and not browser and not cluster"

bench: $(VENV)/installed-test
	$(BIN)/python benchmarks/run.py

# How cost grows; docs/scale.md reads it. Larger: SCALE="--patience 600 --attempts 10000000".
scale: $(VENV)/installed-test
	$(BIN)/python benchmarks/scale.py --out docs/figures/scale.svg $(SCALE)

# The same bytes from any number of workers, from Dask and from shards, some of them killed.
identity: $(VENV)/installed-test
	$(BIN)/python benchmarks/identity.py --json benchmarks/measured/identity.json

# A comparison of which something is killed every 20 seconds.
MINUTES ?= 30
soak: $(VENV)/installed-test
	$(BIN)/python benchmarks/soak.py --minutes $(MINUTES) --json benchmarks/measured/soak.json

# Spoiled files for every reader; FIRST=40000 goes on from there.
INPUTS ?= 100000
FIRST ?= 0
fuzz: $(VENV)/installed-test
	nice -n 10 $(BIN)/python benchmarks/fuzz.py --first $(FIRST) --inputs $(INPUTS) --keep faults

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

# The lessons, run and stored with what they put out; LESSONS="3 5" runs these two.
lessons: $(VENV)/installed-test
	$(BIN)/python docs/run_lessons.py $(LESSONS)

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
	$(MAKE) lock-hashes

# The same versions for every platform, with the hashes of all their files.
lock-hashes: $(TOOLS)/installed
	(sed -n '/^#/p' locked.txt; $(UV) pip compile -q pyproject.toml $(EXTRAS) -c constraints.txt --universal \
	  --python-version $(OLDEST) --generate-hashes --no-annotate --no-header) > locked.new
	mv locked.new locked.txt

# .venv from the locked set alone, each file compared with its hash; torch is PyPI's build.
install-locked: $(BIN)/python
	$(PIP) install -q --require-hashes -r locked.txt
	$(PIP) install -q --no-deps --no-build-isolation -e .
	@touch $(VENV)/installed $(VENV)/installed-test

# Known security advisories. Where the service that knows them cannot be reached, it says so.
audit: $(TOOLS)/installed
	@$(TOOLS)/bin/python .ci/audit.py $(TOOLS)/bin/pip-audit constraints.txt

# Whether the locked set can be installed from wheels alone, with each Python that is supported.
pythons: $(TOOLS)/installed
	@for python in $(PYTHONS); do \
	  $(UV) pip compile -q pyproject.toml $(EXTRAS) -c constraints.txt --python-version $$python \
	    --only-binary :all: --no-annotate --no-header -o $(TOOLS)/for-$$python.txt || exit 1; \
	  echo "Python $$python: $$(grep -c == $(TOOLS)/for-$$python.txt) packages, all of them as wheels"; \
	done

# The tests with the lowest versions that pyproject.toml allows, in an environment of its own (6 GB:
# the oldest torch there is brings CUDA). TESTS=tests/world runs some of them.
MINIMUM := .venv-minimum
TESTS ?= tests
test-minimum: $(TOOLS)/installed
	$(UV) pip compile -q pyproject.toml $(EXTRAS) --resolution lowest-direct --python-version $(OLDEST) \
	  --no-annotate --no-header -o $(TOOLS)/lowest.txt
	test -x $(MINIMUM)/bin/python || $(PYTHON) -m venv $(MINIMUM)
	$(UV) pip sync -q --python $(MINIMUM)/bin/python $(TOOLS)/lowest.txt
	$(UV) pip install -q --python $(MINIMUM)/bin/python --no-deps -e .
	$(MINIMUM)/bin/python -m pytest -n auto -q $(TESTS)

# What a release consists of, and whether each of its files works by itself.
dist: $(VENV)/installed-test
	rm -rf dist
	$(BIN)/python -m hatchling build

check-dist:
	.ci/check_dist $(PYTHON) dist/*

clean:
	rm -rf $(VENV) $(TOOLS) $(MINIMUM) faults build dist docs/_build .pytest_cache .mypy_cache .ruff_cache .hypothesis

$(BIN)/python:
	$(PYTHON) -c 'import sys; sys.exit("Python 3.11.5 or newer is needed, and this is " + sys.version.split()[0] + "; pass PYTHON=...") if sys.version_info < (3, 11, 5) else None'
	$(PYTHON) -m venv $(VENV)

$(VENV)/installed: $(BIN)/python pyproject.toml constraints.txt
	$(PIP) install -q -c constraints.txt -e .
	@touch $@

$(VENV)/installed-test: $(BIN)/python pyproject.toml constraints.txt
	$(PIP) install -q -c constraints.txt -e ".[test]"
	@touch $@ $(VENV)/installed

$(TOOLS)/installed: Makefile
	$(PYTHON) -m venv $(TOOLS)
	$(TOOLS)/bin/python -m pip --disable-pip-version-check install -q uv==0.13.9 pip-audit==2.10.1
	@touch $@

$(VENV)/installed-notebooks: $(BIN)/python pyproject.toml constraints.txt
	$(PIP) install -q -c constraints.txt -e ".[notebooks]"
	@touch $@ $(VENV)/installed
