# Everything here sets itself up: all it needs is make and Python 3.11 or later (another one: make PYTHON=python3.12 …).

PYTHON ?= python3
VENV := .venv
RUN := $(VENV)/bin/python -m
READY := $(VENV)/.ready
CASES ?= 1000000
HOSTILE ?= 100000
PROCESSES ?= 1000
PARTS ?=
BASE ?= HEAD
PROBLEMS ?= 5000

.PHONY: help problems test pytest lint types imports slow fuzz hostile processes tripwire bench wheel clean

help:  ## what can be made
	@sed -n 's/^\([a-z]*\):.*## */make \1\t/p' Makefile | expand -t 16

problems: $(READY)  ## solve the examples in problems/
	@$(VENV)/bin/python problems/solve_all.py

test: $(READY)  ## lint, types, import order, tests
	@$(MAKE) --no-print-directory --jobs 2 lint types imports pytest

pytest: $(READY)  ## the tests alone
	$(RUN) pytest --numprocesses auto --dist worksteal --durations 25

lint: $(READY)  ## style and layout of the source
	$(RUN) ruff check
	$(RUN) ruff format --check

types: $(READY)  ## static types
	$(RUN) mypy

imports: $(READY)  ## who may import whom
	$(VENV)/bin/lint-imports --no-logo

slow: $(READY)  ## the tests that take longer
	$(RUN) pytest -m slow

fuzz: $(READY)  ## a million random problems, in parts that go on where they ended (make fuzz CASES=1000 PARTS=1-4)
	$(RUN) tests.trials.campaign --cases $(CASES) --of 50 --parts "$(PARTS)"

hostile: $(READY)  ## 100,000 files and command lines that mean harm (make hostile HOSTILE=1000 for fewer)
	$(RUN) tests.trials.campaign --kinds tests.hostile.kinds --cases $(HOSTILE) --of 10 --record .fuzz/hostile

processes: $(READY)  ## 1,000 of those as whole processes, with attacks by size among them, one at a time
	$(RUN) tests.trials.campaign --kinds tests.hostile.processes --cases $(PROCESSES) --of 10 --parts "$(PARTS)" \
	    --processes 1 --record .fuzz/processes

tripwire: $(READY)  ## what is answered otherwise than by another commit (make tripwire BASE=main PROBLEMS=200 for fewer)
	rm -rf .tripwire
	git worktree prune
	git worktree add --quiet --detach .tripwire/base $(BASE)
	cd .tripwire/base && ../../$(RUN) tests.tripwire record .. --random $(PROBLEMS)
	git worktree remove --force .tripwire/base
	$(RUN) tests.tripwire compare .tripwire --random $(PROBLEMS)

bench: $(READY)  ## the comparisons with other programs, and their page in docs/
	$(RUN) benchmarks.table --long

wheel: $(READY)  ## sdist and wheel in dist/
	$(RUN) build

clean:  ## remove what was made, the environment too
	rm -rf $(VENV) dist .tripwire .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis

# The environment, made once and again whenever pyproject.toml changes. Dependency groups need pip 25.1.
$(READY): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "mbm needs Python 3.11 or later: make PYTHON=…")'
	$(PYTHON) -m venv $(VENV)
	$(RUN) pip install --quiet --disable-pip-version-check --upgrade "pip>=25.1"
	$(RUN) pip install --quiet --editable . --group dev
	@touch $(READY)
