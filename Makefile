# make demo: set up .venv, run the bundled dive, say where the report is. make test: set up, run all tests. make help lists all.
PYTHON ?= python3
NAME ?= bluerov2_dvl
LOGS ?= tests/data
VENV := .venv
STAMP := $(VENV)/.installed
export PATH := $(CURDIR)/$(VENV)/bin:$(PATH)

.PHONY: help setup demo campaign report inspect diff gallery reproduce regress test test-all lint format declarations lock bench agreement clean twin circle fuzz

help:
	@echo "make demo                 set up .venv and run the bundled real dive"
	@echo "make campaign NAME=x      bring campaign x up to date through DVC"
	@echo "make report NAME=x        open the report of campaign x"
	@echo "make inspect NAME=x       look at the run of campaign x in the Rerun viewer"
	@echo "make gallery              the cases of docs/gallery anew, with pictures"
	@echo "make diff A=x B=y         what changed from run x to run y"
	@echo "make reproduce            a thesis's tables beside those of a twin (NAME=vt690_twin unless said)"
	@echo "make regress              run what has golden tables and compare (NAME=x: that campaign)"
	@echo "make test                 set up and run the tests"
	@echo "make test-all             and those that only a release needs, as other processors run them too"
	@echo "make twin                 fly the VT 690 twin, write its logs, run the chain, compare with the truth"
	@echo "make circle               fly the H-AUV in closed loop, log, identify, redesign the controller on what was found, fly again"
	@echo "make fuzz                 damage logs of every format in every way (long); READER=tlog: of one"
	@echo "make lint                 ruff and mypy"
	@echo "make bench                benchmarks: figures and ratios as JSON"
	@echo "make agreement LOGS=DIR   readers against pymavlink and pyulog on every log of a folder"
	@echo "make declarations         write params.yaml, dvc.yaml and docs/equations.md from the code"
	@echo "make lock                 pin the dependencies anew"
	@echo "make clean                remove results and caches, not .venv"

setup: $(STAMP)

# uv when present (seconds), pip otherwise. Nothing is fetched again until the lock or pyproject.toml changes.
$(STAMP): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "auvid needs Python 3.11 or newer. Say which one: make $(MAKECMDGOALS) PYTHON=python3.12"; exit 1; }
	@test -x $(VENV)/bin/python || $(PYTHON) -m venv $(VENV)
	@if command -v uv >/dev/null; then \
		uv pip install --quiet --python $(VENV)/bin/python --require-hashes -r requirements.lock && \
		uv pip install --quiet --python $(VENV)/bin/python --no-deps --no-build-isolation -e . ; \
	else \
		$(VENV)/bin/python -m pip install --quiet --require-hashes -r requirements.lock && \
		$(VENV)/bin/python -m pip install --quiet --no-deps --no-build-isolation -e . ; \
	fi
	@touch $@

demo: $(STAMP)
	auvid run bluerov2_dvl

campaign: $(STAMP) .dvc/config.local
	@grep -qE "^ *- +$(NAME) *(#|$$)" params.yaml || { echo "campaign $(NAME) is not in the list 'campaigns:' of params.yaml: add a line '  - $(NAME)' and run make declarations"; exit 1; }
	dvc repro --glob 'report*@$(NAME)'
	@auvid report $(NAME)

report: $(STAMP)
	@auvid report $(NAME) --open

inspect: $(STAMP)
	@auvid inspect $(NAME)

# Runs the cases of docs/gallery/cases.yaml and takes their pictures; needs xvfb, xauth and mesa-vulkan-drivers.
gallery: $(STAMP)
	python -m auvid.pipeline.commands.inspect.gallery

diff: $(STAMP)
	@test -n "$(A)" -a -n "$(B)" || { echo "say what: make diff A=bluerov2_dvl B=tests/golden/bluerov2_dvl"; exit 1; }
	@auvid diff $(A) $(B)

reproduce: TWIN = $(if $(filter command environment,$(firstword $(origin NAME))),$(NAME),vt690_twin)
reproduce: $(STAMP)
	@auvid reproduce $(TWIN)

# The whole closed loop on the simulated campaign: fly, write logs, run the chain on them, compare with the truth; fails where a bound of the campaign is missed.
twin: $(STAMP)
	auvid run vt690_twin

# Rewrites the logs of hauv_circle and the model card of hauv_redesign.
circle: $(STAMP)
	python campaigns/hauv_circle/make_logs.py
	auvid run hauv_circle
	cp runs/hauv_circle/synthesise/model_card/prestero.json campaigns/hauv_redesign/prestero.json
	auvid run hauv_redesign

# Damage to small logs of every format, an hour on two cores; a failing case is kept under tests/data/fuzz.
fuzz: $(STAMP)
	python -m tests.faults.fuzz $(addprefix --reader ,$(READER))

# Every campaign with golden tables unless NAME= is given; all are compared before the first departure fails the target.
regress: REGRESS = $(if $(filter command environment,$(firstword $(origin NAME))),$(NAME),$(notdir $(wildcard tests/golden/*)))
regress: $(STAMP)
	@status=0; for name in $(REGRESS); do \
		auvid run $$name --until validate && auvid regress $$name || status=1; \
	done; exit $$status

# Two or more workers; campaigns that several tests look at run once for all of them.
test: $(STAMP)
	pytest -n auto --dist worksteal -m "not release"

# Also what only a release needs, then the numeric tests as other processors would run them.
test-all: $(STAMP)
	pytest -n auto --dist worksteal
	python tools/dispatches.py

lint: $(STAMP)
	ruff check .
	ruff format --check .
	mypy

format: $(STAMP)
	ruff check --fix .
	ruff format .

declarations: $(STAMP)
	python -m auvid.pipeline.execution.generate_dvc
	python tools/equations.py

lock:
	uv pip compile pyproject.toml --extra dev --universal --python-version 3.11 --generate-hashes --no-header --no-annotate \
		--no-emit-index-url --no-emit-find-links --quiet -o requirements.lock

bench: $(STAMP)
	@python -m benchmarks

agreement: $(STAMP)
	@python -m tests.support.agreement $(LOGS)

clean:
	rm -rf runs build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis

# DVC works with git, and without it (an unpacked archive) if told so.
.dvc/config.local: | $(STAMP)
	@if git rev-parse --is-inside-work-tree >/dev/null 2>&1; then touch $@; else dvc config --local core.no_scm true; fi
