# Each target sets up what it needs: a virtual environment in .venv from any Python 3.11 or later, nothing else is required.
#   make demo       the whole example study, results in out/demo
#   make test       the tests (a few minutes on two cores)       make test-all   the slow ones too
#   make bench      the benchmarks                               make lint       ruff and mypy

SHELL := /bin/sh
PYTHON ?= $(shell for p in python3 python3.13 python3.12 python3.11 python3.14 python; do \
	$$p -c 'import sys, venv; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && { command -v $$p; break; }; done)
BIN := .venv/bin
# One thread a process: the tests already use one process a core.
ONE_THREAD := OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MKL_NUM_THREADS=1
WORKERS ?= 2
# Two makes at the same time take turns at the environment where flock exists.
TAKE_TURNS := $(shell command -v flock >/dev/null 2>&1 && echo "flock .venv.lock")

.PHONY: demo test test-all test-slow bench lint clean
.DELETE_ON_ERROR:

demo: .venv/ready-all
	$(BIN)/flexplant demo -o out/demo

test: .venv/ready-dev
	$(ONE_THREAD) $(BIN)/python -m pytest -n $(WORKERS)

test-all: .venv/ready-dev
	$(ONE_THREAD) $(BIN)/python -m pytest -n $(WORKERS) -m ""

test-slow: .venv/ready-dev
	$(ONE_THREAD) $(BIN)/python -m pytest -n $(WORKERS) -m slow

bench: .venv/ready-bench
	@for script in benchmarks/bench_*.py; do echo "== $$script"; $(ONE_THREAD) $(BIN)/python "$$script" || exit 1; done

lint: .venv/ready-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

.venv/bin/python:
	@test -n "$(PYTHON)" || { echo "flexplant needs Python 3.11 or later with venv; set PYTHON=/path/to/python3" >&2; exit 2; }
	$(TAKE_TURNS) sh -c 'test -x $@ || "$(PYTHON)" -m venv .venv'

.venv/ready-%: pyproject.toml .venv/bin/python
	$(TAKE_TURNS) sh -c 'test $@ -nt pyproject.toml || { $(BIN)/python -m pip install -q --disable-pip-version-check -e ".[$*]" && touch $@; }'

clean:
	rm -rf .venv .venv.lock out build dist
