# The project's commands. Each sets up .venv first: on a bare machine it needs only Python 3.11 or later.

PYTHON ?= python3
BIN := .venv/bin
INSTALLED := .venv/.installed
# Metaworld needs an older MuJoCo than the scenes of envs/ do: it has an environment of its own.
WITH_METAWORLD := .venv-metaworld
METAWORLD_INSTALLED := $(WITH_METAWORLD)/.installed
# A file of tests to a process, a process to a core; each would take all cores for its tensors.
PYTEST := OMP_NUM_THREADS=1 $(BIN)/python -m pytest --numprocesses auto --maxprocesses 8 \
  --dist loadfile --no-loadscope-reorder
# Installed without its requirements where pyproject.toml leaves it out (Python 3.13 and later).
DM_CONTROL := $(shell sed -n 's/^ *"\(dm-control[^;]*\);.*/\1/p' pyproject.toml)

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help setup demo metaworld test test-slow lint types check clean

help:  ## list these commands
	@sed -n 's/^\([a-z-]*\):.*## /  make \1\t/p' $(MAKEFILE_LIST) | expand -t 20

setup: $(INSTALLED)  ## install everything into .venv

demo: $(INSTALLED)  ## run both experiments of the paper: imitating a drink, and following walls
	$(BIN)/python -m train.postural_imitation
	$(BIN)/python -m train.wall_following --condition-steps 1000

# Options are given as ARGUMENTS: make metaworld ARGUMENTS="--tasks development --draws 1"
metaworld: $(METAWORLD_INSTALLED)  ## run the Metaworld benchmark in .venv-metaworld: hours; it goes on where it stopped
	OMP_NUM_THREADS=1 $(WITH_METAWORLD)/bin/python -m benchmarks.metaworld $(ARGUMENTS)

test: $(INSTALLED)  ## run the fast tests
	$(PYTEST) -m "not slow"

test-slow: $(INSTALLED)  ## run the slow tests
	$(PYTEST) -m slow

lint: $(INSTALLED)  ## check format and style
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .

types: $(INSTALLED)  ## check types
	$(BIN)/pyright

check: lint types test test-slow  ## check format, style and types, and run all tests

clean:  ## remove .venv, .venv-metaworld and what the tools leave behind; runs/ stays
	rm -rf .venv $(WITH_METAWORLD) build dist *.egg-info lerobot_policy_pacnet/src/*.egg-info .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# The stamp is written last, so an interrupted installation is done again, from nothing.
$(INSTALLED): pyproject.toml lerobot_policy_pacnet/pyproject.toml
	@command -v $(PYTHON) > /dev/null \
	  || { echo "make: no $(PYTHON) here; name a Python 3.11 or later: make PYTHON=/path/to/python"; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "make: Python 3.11 or later is needed, $(PYTHON) is $$($(PYTHON) -V 2>&1); name another: make PYTHON=python3.12"; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2> /dev/null \
	  || { echo "make: $(PYTHON) has no venv or ensurepip; on Debian and Ubuntu: apt install python3-venv"; exit 1; }
	@echo "Installing pacnet and its tools into .venv: 2 to 8 minutes, 9 GB ..."
	@test -e $@ || rm -rf .venv
	@rm -f $@
	@test -d .venv || $(PYTHON) -m venv .venv
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]' --editable './lerobot_policy_pacnet[training]'
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps "$(DM_CONTROL)"
	@touch $@

$(METAWORLD_INSTALLED): pyproject.toml
	@echo "Installing pacnet and Metaworld into $(WITH_METAWORLD): 2 to 8 minutes, 6 GB ..."
	@test -e $@ || rm -rf $(WITH_METAWORLD)
	@rm -f $@
	@test -d $(WITH_METAWORLD) || $(PYTHON) -m venv $(WITH_METAWORLD)
	@$(WITH_METAWORLD)/bin/python -m pip install --quiet --disable-pip-version-check --editable '.[metaworld]'
	@touch $@
