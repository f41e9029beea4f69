# make demo: set up .venv, run the bundled dive, say where the report is. make test: set up, run the tests. make help lists all.
PYTHON ?= python3
LOGS ?= tests/data
# NAME=x chooses a campaign; without it each target has its own.
CAMPAIGN = $(or $(NAME),bluerov2_dvl)
TWIN = $(or $(NAME),vt690_twin)
GOLDEN = $(or $(NAME),$(notdir $(wildcard tests/golden/*)))
VENV := .venv
# What is installed: all that running needs, on top of it DVC, and all that testing needs.
RUN := $(VENV)/.run-installed
WITH_DVC := $(VENV)/.dvc-installed
TEST := $(VENV)/.test-installed
TYPING := build/typing/auvid
export PATH := $(CURDIR)/$(VENV)/bin:$(PATH)

.PHONY: help setup demo campaign report inspect diff gallery reproduce regress test test-all lint typing format declarations docs lock bench agreement clean twin circle fuzz

help:
	@echo "make setup                set up .venv for working on auvid: run, test, lint; compile the loops"
	@echo "make demo                 set up .venv and run the bundled real dive"
	@echo "make campaign NAME=x      bring campaign x up to date through DVC"
	@echo "make report NAME=x        open the report of campaign x"
	@echo "make inspect NAME=x       look at the run of campaign x in the Rerun viewer"
	@echo "make gallery              run the cases of docs/gallery and take their pictures"
	@echo "make diff A=x B=y         what changed from run x to run y"
	@echo "make reproduce            the tables of a thesis and of a twin (NAME=x; vt690_twin without)"
	@echo "make regress              run every campaign and compare with its golden tables and figures (NAME=x: that one)"
	@echo "make test                 set up and run the tests"
	@echo "make test-all             and those that only a release needs, as other processors run them too"
	@echo "make twin                 fly the VT 690 twin, write its logs, run the chain, compare with the truth"
	@echo "make circle               fly the H-AUV in closed loop, identify it from the logs, redesign the controller, fly again"
	@echo "make fuzz                 damage logs of every format in every way (long; goes on where it stopped); READER=tlog: of one; SECONDS=300: for so long"
	@echo "make lint                 ruff and mypy"
	@echo "make format               write all code in the one format"
	@echo "make bench                benchmarks: figures and ratios as JSON"
	@echo "make agreement LOGS=DIR   readers against pymavlink and pyulog on every log of a folder"
	@echo "make declarations         write params.yaml, dvc.yaml and the reference pages of docs/ from the code"
	@echo "make docs                 build the site of the documents into build/docs"
	@echo "make lock                 pin the dependencies: for running, with DVC, for testing"
	@echo "make clean                remove results and caches, not .venv"

setup: $(TEST) typing

# $(call install,LOCK): uv when present, pip otherwise; either shows what it is at. Byte code is made
# now, else the first runs make it.
define install
@echo "installing $$(grep -c '==' $(1)) packages of $(1) into $(VENV)/: with uv a minute or less, with pip some minutes"
@if command -v uv >/dev/null; then pip="uv pip install --compile-bytecode --python $(VENV)/bin/python"; \
	else pip="$(VENV)/bin/python -m pip install --disable-pip-version-check --no-warn-script-location"; fi; \
	$$pip --require-hashes -r $(1) && $$pip --no-deps --no-build-isolation -e . \
	|| { echo "the installation into $(VENV)/ did not finish; it needs a network and 2 GB of disk. Then: make $(MAKECMDGOALS)"; exit 1; }
@touch $@
endef

$(VENV)/bin/python:
	@command -v $(PYTHON) >/dev/null || \
		{ echo "auvid needs Python 3.11 or newer, and '$(PYTHON)' is not there. Debian, Ubuntu: apt-get install python3 python3-venv. Another one: make $(MAKECMDGOALS) PYTHON=python3.12"; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "auvid needs Python 3.11 or newer, and '$(PYTHON)' is $$($(PYTHON) --version 2>&1). Say which one: make $(MAKECMDGOALS) PYTHON=python3.12"; exit 1; }
	@echo "making $(VENV)/ with $$($(PYTHON) --version 2>&1)"
	@$(PYTHON) -m venv $(VENV) || \
		{ rm -rf $(VENV); echo "$(PYTHON) has no venv. Debian, Ubuntu: apt-get install python3-venv"; exit 1; }

# Nothing is fetched again until a lock or pyproject.toml changes.
$(RUN): requirements.lock pyproject.toml setup.py | $(VENV)/bin/python
	$(call install,requirements.lock)

$(WITH_DVC): requirements-dvc.lock pyproject.toml setup.py | $(VENV)/bin/python
	$(call install,requirements-dvc.lock)
	@touch $(RUN)

# Machine code of loops and byte code of tests belong to the test environment, too: both are kept beside their sources.
$(TEST): export PYTHONDONTWRITEBYTECODE =
$(TEST): requirements-test.lock pyproject.toml setup.py | $(VENV)/bin/python
	$(call install,requirements-test.lock)
	@touch $(RUN) $(WITH_DVC)
	@echo "compiling the loops that the tests run: about a minute"
	@pytest -n auto -m compiles || echo "not all loops are compiled: the tests compile the others themselves"

# Folder links in which mypy and editors find the package: build/typing/auvid/stages -> stages.
typing:
	@mkdir -p $(TYPING)
	@for part in data_schemas hydro stages export pipeline auvid/*.py; do \
		ln -sfn ../../../$$part $(TYPING)/$$(basename $$part); done

demo: $(RUN)
	@echo "running a dive of 130 s from its log to the report: about half a minute"
	auvid run bluerov2_dvl

# Whether dvc.yaml has a report of the campaign: a target that matches nothing means all to DVC.
DECLARED = grep -A1 -E '^  report(-[a-z_]+)?:' dvc.yaml | grep -qE 'foreach: (.\{campaigns|\[(.*, )?$(CAMPAIGN)[],])'

campaign: $(WITH_DVC) .dvc/config.local
	@grep -qE "^ *- +$(CAMPAIGN) *(#|$$)" params.yaml || { echo "campaign $(CAMPAIGN) is not in the list 'campaigns:' of params.yaml: add a line '  - $(CAMPAIGN)'"; exit 1; }
	@$(DECLARED) || python -m auvid.pipeline.execution.generate_dvc dvc.yaml
	@$(DECLARED) || { echo "no stage 'report' of dvc.yaml has campaign $(CAMPAIGN)"; exit 1; }
	dvc repro --glob 'report*@$(CAMPAIGN)'
	@ls -d "$(CURDIR)/runs/$(CAMPAIGN)/report/report_html.html"

report: $(RUN)
	@auvid report $(CAMPAIGN) --open

inspect: $(RUN)
	@auvid inspect $(CAMPAIGN)

# Runs the cases of docs/gallery/cases.yaml and takes their pictures; needs xvfb, xauth and mesa-vulkan-drivers.
gallery: $(RUN)
	python -m auvid.pipeline.commands.look.inspect.gallery

diff: $(RUN)
	@test -n "$(A)" -a -n "$(B)" || { echo "say what: make diff A=bluerov2_dvl B=tests/golden/bluerov2_dvl"; exit 1; }
	@auvid diff $(A) $(B)

reproduce: $(RUN)
	@auvid reproduce $(TWIN)

# The whole closed loop on the simulated campaign: fly, write logs, run the chain on them, compare with the truth; fails where a bound of the campaign is missed.
twin: $(RUN)
	auvid run vt690_twin

# Rewrites the logs of hauv_circle and the model card of hauv_redesign.
circle: $(RUN)
	python campaigns/hauv_circle/make_logs.py
	auvid run hauv_circle
	cp runs/hauv_circle/synthesise/model_card/prestero.json campaigns/hauv_redesign/prestero.json
	auvid run hauv_redesign

# Damage to small logs of every format, an hour on two cores; a failing case is kept under tests/data/fuzz.
fuzz: $(TEST)
	python -m tests.faults.fuzz $(addprefix --reader ,$(READER)) $(addprefix --seconds ,$(SECONDS))

# Every campaign with golden content unless NAME= is given; all are compared before the first departure fails the target.
regress: $(RUN)
	@status=0; for name in $(GOLDEN); do \
		auvid run $$name && auvid regress $$name || status=1; \
	done; exit $$status

# Two or more workers; campaigns that several tests look at run once for all of them. Byte code is
# kept even where the environment says not to: tests start dozens of programs.
test test-all: export PYTHONDONTWRITEBYTECODE =
# What tests write stays in memory where that has 2 GB to spare (they take .3): else they wait for the disk.
test: export PYTEST_DEBUG_TEMPROOT = $(shell [ -w /dev/shm ] && df -kP /dev/shm | awk 'NR == 2 && $$4 > 2e6 { print "/dev/shm" }')
test: $(TEST)
	pytest -n auto --dist worksteal -m "not release"

# Also what only a release needs, then the numeric tests as other processors would run them.
test-all: $(TEST)
	pytest -n auto --dist worksteal
	python tools/dispatches.py

lint: $(TEST) typing
	ruff check .
	ruff format --check .
	mypy

format: $(TEST)
	ruff check --fix .
	ruff format .

declarations: $(RUN)
	python -m auvid.pipeline.execution.generate_dvc
	python tools/equations.py
	python tools/reference.py

# Warnings are errors: links, anchors and pages that are in no list of contents.
docs: $(TEST)
	@sphinx-build --quiet --fail-on-warning --jobs auto --doctree-dir build/docs_cache docs build/docs
	@python tools/check_site.py build/docs
	@echo "$(CURDIR)/build/docs/index.html"

# setuptools installs auvid itself.
COMPILE = echo "setuptools>=77" | uv pip compile pyproject.toml - --universal --python-version 3.11 --generate-hashes --no-header \
	--no-annotate --no-emit-index-url --no-emit-find-links --quiet

# Three sets, each within the next: for running, with DVC, and for testing; with Dask apart.
lock:
	$(COMPILE) --extra view -o requirements.lock
	$(COMPILE) --extra view --extra dvc -c requirements.lock -o requirements-dvc.lock
	$(COMPILE) --extra view --extra catalog --extra dask -c requirements.lock -o requirements-dask.lock
	$(COMPILE) --extra view --extra catalog --extra dvc --extra dask --extra test --extra docs -c requirements-dvc.lock -c requirements-dask.lock -o requirements-test.lock

bench: $(RUN) $(TEST)
	@python -m benchmarks

agreement: $(TEST)
	@python -m tests.support.agreement $(LOGS)

clean:
	rm -rf runs build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis

# DVC works with git, and without it (an unpacked archive) if told so.
.dvc/config.local: | $(WITH_DVC)
	@if git rev-parse --is-inside-work-tree >/dev/null 2>&1; then touch $@; else dvc config --local core.no_scm true; fi
