# What a fresh clone needs is python3 with venv, and make. Everything else is set up by the targets themselves.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed

.DEFAULT_GOAL := help
.PHONY: help venv demo test torture bench lint clean mosquitto docs late-replies

help: ## show this list
	@grep -E '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /  make \1\t/' | expand -t 24

venv: $(STAMP) ## make the virtual environment, with everything for demo and tests

$(STAMP): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
		|| { echo "Python 3.11 or newer is needed (make PYTHON=/path/to/python3 ...)" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2> /dev/null \
		|| { echo "Python's venv is missing (apt-get install python3-venv)" >&2; exit 1; }
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[test,demo]'
	@touch $@

mosquitto:
	@deploy/get-mosquitto.sh

demo: $(STAMP) mosquitto ## simulated starters, a broker, the gateway; Ctrl-C ends it all
	@exec $(BIN)/starter-gateway demo

lint: $(STAMP) ## style, types, import contracts, plain words
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	PYTHONPATH=. $(BIN)/lint-imports
	$(BIN)/python -m tests.words

test: $(STAMP) mosquitto lint ## everything that is checked, as CI does
	$(BIN)/python -m pytest

torture: $(STAMP) mosquitto ## every fault in full, some hours; as root also a full and a read-only disk
	$(BIN)/python -m tests.torture $(SCENARIOS)

docs: $(STAMP) ## write the generated parts of the documents
	$(BIN)/python -m tests.family_pages
	$(BIN)/python -m tests.results_page
	$(BIN)/python -m tests.layers_page

$(STAMP)-bench: $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[bench]'
	@touch $@

bench: $(STAMP)-bench mosquitto ## the line's efficiency, beside other masters, in six minutes; pictures in docs/
	@$(BIN)/python -m tests.bench --pictures docs

late-replies: $(STAMP) ## a million requests whose replies come late, twice or out of order; a minute
	LATE_REPLIES=1000000 $(BIN)/python -m pytest tests/line/test_late_replies.py

clean: ## remove what the targets made
	rm -rf $(VENV) build dist *.egg-info .coverage .hypothesis .mypy_cache .pytest_cache .ruff_cache .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
