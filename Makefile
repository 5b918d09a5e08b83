# Two commands do everything: `make all` and `make test`. Neither needs root or a GPU.
#
#   make all  [MANIFEST=manifests/x.toml] [PIPELINE=pipelines/y.toml] [WORKERS=2]
#   make index | poses | detect | lift | fuse | score | report      one stage
#   make test | check | bench | clean

PYTHON   ?= python3
VENV     ?= .venv
MANIFEST ?= manifests/analytic.toml
PIPELINE ?= pipelines/default.toml
WORKERS  ?= 1
ARGS     ?=

BIN       := $(VENV)/bin
INSTALLED := $(VENV)/.installed
DEV       := $(VENV)/.installed-dev
STAGES    := index poses detect lift fuse score report
ANALYTIC  := data/analytic

.DEFAULT_GOAL := all
.PHONY: all install dev test check lint bench clean simulate $(STAGES)

all: install simulate
	$(BIN)/imodbatch run $(MANIFEST) --pipeline $(PIPELINE) --workers $(WORKERS) $(ARGS)

$(STAGES): install simulate
	$(BIN)/imodbatch $@ $(MANIFEST) --pipeline $(PIPELINE) $(ARGS)

# The embedded dataset is generated, not stored; nothing happens when it is already there.
simulate: install
ifeq ($(notdir $(MANIFEST)),analytic.toml)
	@$(BIN)/imodbatch simulate $(ANALYTIC)
endif

test: dev
	$(BIN)/python -m pytest $(ARGS)

check: dev lint
	$(BIN)/python -m pytest $(ARGS)

lint: dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: dev
	$(BIN)/python tests/benchmarks/bench_fusion.py
	$(BIN)/python tests/benchmarks/bench_depth.py
	$(BIN)/python tests/benchmarks/bench_raycast.py

install: $(INSTALLED)
dev: $(DEV)

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Python 3.11 or newer is needed; name one: make PYTHON=python3.12"; exit 1; }
	@$(PYTHON) -m venv $(VENV) 2>/dev/null || $(PYTHON) -m virtualenv -q $(VENV) 2>/dev/null || \
	  { rm -rf $(VENV); echo "No venv module. Debian: apt install python3-venv, or without root:" \
	    "$(PYTHON) -m pip install --user virtualenv"; exit 1; }

$(INSTALLED): pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	@touch $@

$(DEV): pyproject.toml $(INSTALLED)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@

clean:
	rm -rf runs data .mypy_cache .pytest_cache .ruff_cache
