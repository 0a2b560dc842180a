# `make lab` shows the laboratory in a browser, `make notebooks` the lessons in Jupyter, `make test` passes every test.
# Repeating either does nothing twice: what is installed is remembered in $(VENV) until pyproject.toml changes.

PYTHON ?= python3
PORT ?= 5006
NOTEBOOKS ?= my_notebooks
SECONDS ?= 600
NAME ?=
# On two cores, a fourth process saves no time, and takes more of the processor and memory.
WORKERS ?= 3
TOGETHER = --numprocesses $(WORKERS) --dist loadfile --no-loadscope-reorder --durations=10
VENV := .venv
BIN := $(VENV)/bin
# Python compiles a module when it is first imported: the page needs a third of those that are installed.
INSTALL := .ci/install $(BIN)/python --no-compile

.PHONY: help lab notebooks test proof style types pytest docs pictures bench ledger fuzz browser clean
.DEFAULT_GOAL := help

# Where this is set, each of some hundred processes of the tests compiles 3,000 modules of Python again, which
# takes 5 s of a processor.
unexport PYTHONDONTWRITEBYTECODE

help:
	@echo 'make lab        install and open the dashboard on http://localhost:$(PORT) (another port: make lab PORT=8000)'
	@echo 'make notebooks  install, copy the lessons into $(NOTEBOOKS), and open them in JupyterLab'
	@echo 'make test       install and run the tests that a change needs, in three processes at a time (other: make test WORKERS=2)'
	@echo 'make proof      install and run the rest: statistics over many seeds, all cards, real logs, commands of documents'
	@echo 'make docs       install and write the documentation as a site, which needs no network, into build/site'
	@echo 'make pictures   install and take the pictures of the documents, light and dark, in Chromium or Chrome'
	@echo 'make bench      install and measure the speed'
	@echo 'make ledger     install and repeat each measurement of docs/measurements.toml, which takes hours'
	@echo 'make fuzz       install and attack every reader of recordings, live decoder and push of phones, and a served laboratory, 10 minutes each (make fuzz SECONDS=60 NAME=GPX)'
	@echo 'make clean      remove $(VENV) and all caches'
	@echo 'Another Python than $(PYTHON): make lab PYTHON=python3.12'

lab: $(VENV)/.lab
	@$(BIN)/ins-lab serve --port $(PORT)

# The copies are the user's: those that exist are kept. Panel puts its scripts into the page, so that plots
# need no network. Jupyter wants an option of root, who is alone in a container.
notebooks: $(VENV)/.notebooks
	@$(BIN)/ins-lab notebooks copy '$(NOTEBOOKS)'
	@PANEL_INLINE=True $(BIN)/jupyter lab $$([ "$$(id -u)" -ne 0 ] || echo --allow-root) '$(NOTEBOOKS)'

# mypy has one process, and the tests begin with one that compiles while the others wait: they run side by side.
test:
	@$(MAKE) --no-print-directory --jobs=2 $(VENV)/.test browser
	@$(MAKE) --no-print-directory style
	@$(MAKE) --no-print-directory --jobs=2 types pytest

style: $(VENV)/.test
	$(BIN)/ruff check
	$(BIN)/ruff format --check

types: $(VENV)/.test
	$(BIN)/mypy

# One process compiles the modules that tests import, while mypy runs; otherwise, each of the three compiles them all.
# What it cannot import, the tests report.
pytest: $(VENV)/.test
	-@$(BIN)/pytest -m 'not benchmark' --collect-only -qq >/dev/null 2>&1
	$(BIN)/pytest -m 'not benchmark and not proof' $(TOGETHER)

proof: $(VENV)/.test browser
	$(BIN)/pytest -m 'proof and not benchmark' $(TOGETHER)

docs: $(VENV)/.docs
	$(BIN)/python -m sphinx -W --keep-going -c docs/site -b html . build/site
	@echo 'The documentation is build/site/index.html.'

pictures: $(VENV)/.test browser
	$(BIN)/python docs/pictures.py

bench: $(VENV)/.test browser
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1 NUMBA_NUM_THREADS=1 \
	$(BIN)/pytest -m benchmark --capture=no --timeout=1800

ledger: $(VENV)/.test browser
	$(BIN)/python -m tests.benchmarks.ledger

fuzz: $(VENV)/.fuzz
	$(BIN)/python tests/fuzz/hunt.py --seconds $(SECONDS) --name '$(NAME)'

browser:
	@.ci/browser

$(BIN)/pip:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
	  echo "INS Lab needs Python 3.11 or newer; $(PYTHON) is $$($(PYTHON) --version 2>/dev/null || echo missing)." >&2; \
	  echo 'If a newer one is installed, name it: make lab PYTHON=python3.12' >&2; exit 1; }
	@$(PYTHON) -m venv $(VENV) || { \
	  echo 'No virtual environment could be made. On Debian and Ubuntu: sudo apt-get install python3-venv' >&2; exit 1; }

$(VENV)/.lab: pyproject.toml | $(BIN)/pip
	$(INSTALL) --editable '.[fit,fly,live,mavlink]'
	@touch $@

$(VENV)/.notebooks: pyproject.toml | $(BIN)/pip
	$(INSTALL) --editable '.[fit,fly,live,mavlink,notebook]'
	@touch $@ $(VENV)/.lab

# The test extra contains all that the laboratory needs.
$(VENV)/.test: pyproject.toml | $(BIN)/pip
	$(INSTALL) --editable '.[test]'
	@touch $@ $(VENV)/.lab $(VENV)/.docs

$(VENV)/.docs: pyproject.toml | $(BIN)/pip
	$(INSTALL) --editable '.[docs]'
	@touch $@

$(VENV)/.fuzz: pyproject.toml | $(BIN)/pip
	$(INSTALL) --editable '.[test,fuzz]'
	@touch $@ $(VENV)/.test $(VENV)/.lab

clean:
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis test-results
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
