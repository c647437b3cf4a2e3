# What a fresh clone needs is python3 with venv, and make. Everything else is set up by the targets themselves.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps
# The demo asks for less than the tests; what is there for them will do.
DEMO := $(if $(wildcard $(STAMP)),$(STAMP),$(STAMP)-demo)

.DEFAULT_GOAL := help
.PHONY: help venv demo test e2e torture bench fleet slow-box lint lint-types lint-style coverage lock clean mosquitto chromium postgresql prometheus node-red sparkplug-judges web asyncapi home-assistant docs site wheel image deb apt-repo debian programs test-deb test-root late-replies

# Each test of processes starts some, and compiles the program again where no compiled module may be stored.
unexport PYTHONDONTWRITEBYTECODE

# What a service needs, and who operates it.
PACKAGED_EXTRAS := web metrics sparkplug watch completion

# Only these take real time, and have a broker.
E2E := tests/end_to_end
PACKAGES := tests/packages
FAST := $(BIN)/python -m pytest --ignore $(E2E) --ignore $(PACKAGES) --numprocesses auto --dist worksteal
# These mostly wait: more of them at once than there are processors. Those in which moments count come after, two at a
# time, and those that measure time last, one by one.
TOGETHER := $(BIN)/python -m pytest $(E2E) -m 'not alone and not paired' --numprocesses 4 --dist loadgroup --no-loadscope-reorder
PAIRED := $(BIN)/python -m pytest $(E2E) -m paired --numprocesses 2 --dist loadgroup --no-loadscope-reorder
ALONE := $(BIN)/python -m pytest $(E2E) -m alone
# Each distribution in a process of its own, which builds each package once.
PACKAGED := $(BIN)/python -m pytest $(PACKAGES) --numprocesses 2 --dist loadgroup

# Where RETRY is set, as in CI, whose machine others may slow for seconds, what fails in real time is tried once more,
# by itself. Both outputs stay to be read; a second failure counts.
BY_ITSELF := $(BIN)/python -m pytest $(E2E) $(PACKAGES) --last-failed --last-failed-no-failures none
tried = $(1) $(if $(RETRY),--cache-clear || $(BY_ITSELF))

help: ## show this list
	@grep -E '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /  make \1\t/' | expand -t 24

venv: $(STAMP) ## make the virtual environment, with everything for demo and tests

# $(1): the lock, which names every package by its hashes.
define install
@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	|| { echo "Python 3.11 or newer is needed (make PYTHON=/path/to/python3 ...)" >&2; exit 1; }
@$(PYTHON) -c 'import ensurepip, venv' 2> /dev/null \
	|| { echo "Python's venv is missing (apt-get install python3-venv)" >&2; exit 1; }
@test -x $(BIN)/python || deploy/progress.sh "Making $(VENV)" $(PYTHON) -m venv $(VENV)
@deploy/progress.sh "Installing what $(1) names" $(PIP) --require-hashes --requirement $(1)
@deploy/progress.sh "Installing the program" $(PIP) --editable .
@touch $@
endef

$(STAMP): pyproject.toml requirements.lock
	$(call install,requirements.lock)

$(STAMP)-demo: pyproject.toml deploy/demo.lock
	$(call install,deploy/demo.lock)

mosquitto:
	@deploy/get-mosquitto.sh

chromium:
	@deploy/get-chromium.sh

prometheus:
	@deploy/get-prometheus.sh

postgresql:
	@deploy/get-postgresql.sh

node-red: $(STAMP)
	@deploy/get-node-red.sh

sparkplug-judges: $(STAMP)
	@tests/end_to_end/sparkplug/get-judges.sh

web: $(STAMP) ## fetch what the status page takes from npm: uPlot, for its plots
	@deploy/get-uplot.sh

demo: $(DEMO) ## simulated starters, a broker, the gateway; PLANT=1: they run by themselves; Ctrl-C ends it all
	@deploy/get-mosquitto.sh --demo
	@deploy/get-uplot.sh
	@exec $(BIN)/starter-gateway demo $(if $(PLANT),--plant)

lint: $(STAMP) ## style, spelling, plain words, types, import contracts
	@$(MAKE) --no-print-directory --jobs 2 --output-sync=target lint-types lint-style

lint-types: # takes as long as the rest together
	$(BIN)/mypy

lint-style:
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/codespell
	PYTHONPATH=. $(BIN)/lint-imports
	$(BIN)/python -m tests.words

asyncapi: $(STAMP)
	@tests/reference/get-asyncapi.sh

home-assistant: $(STAMP)
	@tests/home_assistant/get-home-assistant.sh

test: $(STAMP) mosquitto prometheus asyncapi home-assistant lint ## lint, and every test in virtual time; three minutes
	$(FAST)

e2e: $(STAMP) programs web site node-red sparkplug-judges ## every test in real time: processes, ptys, a real broker; seven minutes
	$(call tried,$(TOGETHER))
	$(call tried,$(PAIRED))
	$(call tried,$(ALONE))

test-root: $(STAMP) mosquitto ## as root: what an ordinary user may not do, and packages in fresh systems of Debian
	$(FAST) -m root
	@$(MAKE) --no-print-directory test-deb

programs: mosquitto chromium prometheus postgresql debian # of the distribution, which only root may install

coverage: $(STAMP) mosquitto ## the lines and branches that all tests together run through
	$(FAST) --cov --cov-report=
	$(TOGETHER) --cov --cov-report= --cov-append
	$(PAIRED) --cov --cov-report= --cov-append
	$(ALONE) --cov --cov-append

lock: $(STAMP) ## write the locks again: every package with its version and hashes
	$(BIN)/python -m pip install --quiet --disable-pip-version-check pip-tools
	$(BIN)/pip-compile --quiet --upgrade --generate-hashes --strip-extras --no-header --no-emit-index-url \
		--no-emit-trusted-host --no-emit-find-links --extra test --extra demo --output-file requirements.lock pyproject.toml
	$(BIN)/pip-compile --quiet --upgrade --generate-hashes --strip-extras --no-header --no-emit-index-url --no-annotate \
		--no-emit-trusted-host --no-emit-find-links $(foreach extra,$(PACKAGED_EXTRAS),--extra $(extra)) \
		--constraint requirements.lock --output-file deploy/requirements.lock pyproject.toml
	$(BIN)/pip-compile --quiet --generate-hashes --strip-extras --no-header --no-emit-index-url --no-annotate \
		--no-emit-trusted-host --no-emit-find-links --extra demo \
		--constraint requirements.lock --output-file deploy/demo.lock pyproject.toml

torture: $(STAMP) mosquitto ## every fault in full, some hours; as root also a full and a read-only disk
	$(BIN)/python -m tests.lab.torture $(SCENARIOS)
	$(FAST) -m hypothesis --hypothesis-profile random

docs: $(STAMP) ## write the generated parts of the documents
	$(BIN)/python -m tests.reference
	$(BIN)/python -m tests.size_page

site: $(STAMP) ## build the documentation as a site, into the package: `starter-gateway docs` serves it
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

wheel: $(STAMP)-deb web site ## build the wheel into dist/, with documentation, page and deploy kit, as PyPI takes it
	$(BIN)/python -m deploy.wheel
	$(BIN)/twine check --strict dist/*.whl

# Podman's own format has no health check.
image: ## build the container image, by Podman or Docker
	$(if $(shell command -v podman),podman build --format docker,docker build) --tag starter-gateway --file deploy/oci/Containerfile .

$(STAMP)-deb: $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[deb]'
	@touch $@

deb: $(STAMP)-deb web site ## build the Debian packages into dist/: all six, or DISTRIBUTION=deb12 and ARCHITECTURE=amd64
	@$(BIN)/python -m deploy.deb.build $(if $(DISTRIBUTION),--distribution $(DISTRIBUTION)) $(if $(ARCHITECTURE),--architecture $(ARCHITECTURE))

apt-repo: $(STAMP)-deb ## of the packages in dist/ a signed apt repository, dist/apt: GPG_KEY=fingerprint or address
	@$(if $(GPG_KEY),,$(error GPG_KEY= names the key that signs, as gpg knows it))
	@$(BIN)/python -m deploy.apt_repository --key '$(GPG_KEY)'

debian:
	@$(PACKAGES)/get-debian.sh

test-deb: $(STAMP)-deb web site debian ## packages and wheel in fresh systems of Debian, as root; five minutes
	$(call tried,$(PACKAGED))

bench: $(STAMP) mosquitto ## the line's efficiency, stops, cost of a transaction: five minutes
	@$(BIN)/python -m tests.lab.bench

fleet: $(STAMP) mosquitto ## what two gateways ask of a broker: a minute; OPTIONS="--gateways 10 --starters 32"
	$(BIN)/python -m tests.lab.fleet $(OPTIONS)

slow-box: $(STAMP) mosquitto ## the gateway with a fifth of a processor, as root: six minutes
	$(BIN)/python -m tests.lab.slow_box $(OPTIONS)

late-replies: $(STAMP) ## ten million requests whose replies come late, lost, cut, garbled or refused; half an hour
	@for late in 0.3 1 3 30; do for way in "" --ordered-over-all; do \
	    $(BIN)/python -m tests.lab.late_model --seeds 1-50 --requests 25000 --late-s $$late --units 8 --mix $$way | tail -n 1; \
	done; done

clean: ## remove what the targets made
	rm -rf $(VENV) build dist gateway/docs_site *.egg-info .coverage .hypothesis .mypy_cache .pytest_cache .ruff_cache .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
