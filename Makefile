# What a fresh clone needs is python3 with venv, and make. Everything else is set up by the targets themselves.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed

.DEFAULT_GOAL := help
.PHONY: help venv demo test e2e torture bench lint coverage lock clean mosquitto docs late-replies

# Only these take real time, and have a broker.
E2E := tests/end_to_end
FAST := $(BIN)/python -m pytest --ignore $(E2E) --numprocesses auto --dist worksteal
# These mostly wait: more of them at once than there are processors. Those that measure time come after, one by one.
TOGETHER := $(BIN)/python -m pytest $(E2E) -m 'not alone' --numprocesses 4 --dist loadgroup --no-loadscope-reorder
ALONE := $(BIN)/python -m pytest $(E2E) -m alone

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

lint: $(STAMP) ## style, spelling, types, import contracts
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/codespell
	$(BIN)/mypy
	PYTHONPATH=. $(BIN)/lint-imports

test: $(STAMP) mosquitto lint ## lint, and every test in virtual time; two minutes
	$(FAST)

e2e: $(STAMP) mosquitto ## every test in real time: processes, ptys, a real broker; some minutes
	$(TOGETHER)
	$(ALONE)

coverage: $(STAMP) mosquitto ## the lines and branches that all tests together run through
	$(FAST) --cov --cov-report=
	$(TOGETHER) --cov --cov-report= --cov-append
	$(ALONE) --cov --cov-append

lock: $(STAMP) ## write requirements.lock anew: every package with its version and hashes
	$(BIN)/python -m pip install --quiet --disable-pip-version-check pip-tools
	$(BIN)/pip-compile --quiet --upgrade --generate-hashes --strip-extras --no-header --no-emit-index-url \
		--no-emit-trusted-host --no-emit-find-links --extra test --extra demo --output-file requirements.lock pyproject.toml

torture: $(STAMP) mosquitto ## every fault in full, some hours; as root also a full and a read-only disk
	$(BIN)/python -m tests.torture $(SCENARIOS)
	$(FAST) -m hypothesis --hypothesis-profile random

docs: $(STAMP) ## write the generated halves of docs/families anew
	$(BIN)/python -m tests.family_pages

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
