# navopt. `make study` runs the demonstration, `make test` the checks, `make help` lists the rest.
# A bare machine needs Python 3.11 or later and make; everything is installed into .venv.

.DEFAULT_GOAL := help
.NOTPARALLEL:
.PHONY: help env study test test-slow check docs bench wheel-test clean

VENV := .venv
BIN := $(VENV)/bin
OUT ?= results/gravity-demo
# An interpreter to use instead of the first suitable one: make PYTHON=/path/to/python3.12 env
PYTHON ?=
CANDIDATES := $(or $(PYTHON),python3 python3.14 python3.13 python3.12 python3.11)
SUITABLE := import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))

export PIP_DISABLE_PIP_VERSION_CHECK := 1

help: ## list the targets
	@awk -F':.*## ' '/^[a-z-]+:.*## /{printf "  make %-11s %s\n", $$1, $$2}' Makefile

env: $(VENV)/.installed ## make .venv and install navopt into it

study: $(VENV)/.installed ## run the demonstration study into results/gravity-demo
	$(BIN)/navopt run gravity-demo --out $(OUT)

test: check ## check, then all tests but the slow ones
	$(BIN)/python -m pytest -n auto -m "not slow" tests

test-slow: $(VENV)/.installed-test ## the statistical tests that take minutes
	$(BIN)/python -m pytest -n auto -m slow tests

check: $(VENV)/.installed-test ## style, format and types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

docs: $(VENV)/.installed-docs ## build the documentation into docs/_build/html
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs docs/_build/html
	@echo "docs/_build/html/index.html"

bench: $(VENV)/.installed-bench ## measure speed, then compare abc with pygmo's colony (minutes)
	$(BIN)/python -m comparisons.speed
	$(BIN)/python -m comparisons.independent_bee_colony

wheel-test: $(VENV)/.installed ## build the wheel, install it elsewhere and run a small study with it
	sh tests/wheel_check.sh $(BIN)/python

clean: ## remove caches and built documentation; .venv and results stay
	rm -rf docs/_build docs/reference/generated dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find navopt baselines comparisons tests docs -name __pycache__ -type d -prune -exec rm -rf {} +

# The first interpreter that is new enough and can make an environment.
$(BIN)/python:
	@for python in $(CANDIDATES); do \
	  if "$$python" -c '$(SUITABLE)' >/dev/null 2>&1; then \
	    echo "making $(VENV) with $$python ($$("$$python" -V 2>&1))"; \
	    exec "$$python" -m venv --clear $(VENV); \
	  fi; \
	done; \
	echo "navopt needs Python 3.11 or later with the modules venv and ensurepip; tried: $(CANDIDATES)." >&2; \
	echo "Install one (on Debian and Ubuntu: python3 and python3-venv), or name it: make PYTHON=/path/to/python3 env" >&2; \
	exit 1

# A stamp is written after pip has succeeded, so an interrupted installation is taken up again.
$(VENV)/.installed: pyproject.toml constraints.txt | $(BIN)/python
	@echo "installing navopt into $(VENV) (a minute or two the first time)"
	@$(BIN)/python -m pip install -q -c constraints.txt -e .
	@touch $@

$(VENV)/.installed-%: pyproject.toml constraints.txt | $(BIN)/python
	@echo "installing navopt[$*] into $(VENV) (a minute or two the first time)"
	@$(BIN)/python -m pip install -q -c constraints.txt -e '.[$*]'
	@touch $(VENV)/.installed $@
