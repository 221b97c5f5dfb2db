# Everything runs in a virtual environment of its own, .venv, made on first use.
PYTHON ?= python3
BIN := .venv/bin
RUN := $(BIN)/python -m
PIP := $(RUN) pip --disable-pip-version-check install -q -c constraints.txt
TEST := .venv/installed-test
.PHONY: help compare test test-fast lint style types imports tests bench docs notebooks lessons \
        evidence evidence-check json-schemas lock dist check-dist clean
help: # each target, with what stands behind its name
	@sed -n 's/^\([a-z-]*\):[^#]*# \(.*\)/make \1: \2/p' $(MAKEFILE_LIST)

compare: .venv/installed # play the default comparison, write results/default/report.html
	$(BIN)/causal-openlock compare default --out results/default
test: $(TEST) # lint, type-check, and run every test
	@$(MAKE) --no-print-directory --keep-going -j3 style types tests
test-fast: $(TEST) # the tests without long plays, browsers and clusters
	@$(RUN) pytest -n auto --dist loadfile -q -m "not slow and not browser and not cluster"
tests: $(TEST) # slow files first, each whole in one worker
	@$(RUN) pytest -n auto --dist loadfile --no-loadscope-reorder -q --durations=10
lint: style types imports # what each commit has to pass
style: $(TEST)
	@$(BIN)/ruff format --check . && $(BIN)/ruff check .
types: $(TEST)
	@$(BIN)/mypy
imports: $(TEST)
	@$(BIN)/lint-imports
bench: $(TEST) # speed against named peers, in the same run
	$(BIN)/python benchmarks/run.py
docs: $(TEST) # the documentation: docs/_build/index.html
	$(RUN) sphinx -W --keep-going -q -c docs . docs/_build
notebooks: .venv/installed-notebooks # the lessons in JupyterLab, to run and to change
	$(RUN) jupyterlab notebooks
lessons: .venv/installed-notebooks # run the lessons and store what they put out: LESSONS=notebooks/03*
	place=$$(mktemp -d) && cp $(or $(LESSONS),notebooks/0*.ipynb) $$place && $(RUN) nbconvert --to notebook --execute \
	  --ExecutePreprocessor.record_timing=False --TagRemovePreprocessor.enabled=True \
	  --TagRemovePreprocessor.remove_all_outputs_tags=remove-output --inplace $$place/*.ipynb && cp $$place/*.ipynb notebooks
evidence: .venv/installed # play a study, as NAME=worth_rooms; without a name, list all
	$(RUN) evidence $(NAME)
evidence-check: .venv/installed # that all numbers and verdicts follow from what is stored
	$(RUN) evidence --check
json-schemas: .venv/installed # the JSON Schemas that editors use, after a file format has changed
	$(BIN)/python -c "import json; from causal_openlock.schemas.schema import json_schema; print(json.dumps(json_schema(), indent=2))" > schemas/schema.json
	$(BIN)/python -c "import json; from causal_openlock.experiment.declare import json_schema; print(json.dumps(json_schema(), indent=2))" > experiments/schema.json
lock: # the exact versions of everything, from a fresh environment: constraints.txt
	rm -rf .venv-lock && $(PYTHON) -m venv .venv-lock
	.venv-lock/bin/python -m pip install -q torch==2.13.0 -e ".[test,notebooks]"
	(sed -n '/^#/p' constraints.txt; .venv-lock/bin/python -m pip freeze --exclude-editable | sed 's/+cpu$$//') > constraints.new
	mv constraints.new constraints.txt && rm -rf .venv-lock
dist: $(TEST) # wheel and sdist
	rm -rf dist && $(RUN) hatchling build
check-dist: # play with each file of dist/, in an environment of its own
	.ci/check_dist $(PYTHON) dist/*
clean: # remove everything that was made, but results/
	rm -rf .venv .venv-* build dist docs/_build .pytest_cache .mypy_cache .ruff_cache .hypothesis

$(BIN)/python:
	$(PYTHON) -c 'import sys; sys.exit("Python 3.11.5 or newer is needed, and this is " + sys.version.split()[0] + "; pass PYTHON=...") if sys.version_info < (3, 11, 5) else None'
	$(PYTHON) -m venv .venv
.venv/installed $(TEST) .venv/installed-notebooks: .venv/i%: $(BIN)/python pyproject.toml constraints.txt
	$(PIP) -e ".$(patsubst nstalled-%,[%],$(filter-out nstalled,$*))"
	@touch $@ .venv/installed
