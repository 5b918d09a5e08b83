# Two commands do everything: `make all` and `make test`. Neither needs root or a GPU.
#
#   make all  [MANIFEST=manifests/x.toml] [PIPELINE=pipelines/y.toml] [WORKERS=2]
#   make table1                     three detectors on simulated houses: the paper's Table 1
#   make index | poses | detect | lift | fuse | score | report      one stage
#   make test | check | bench | clean

PYTHON   ?= python3
VENV     ?= .venv
MANIFEST ?= manifests/house_test.toml
# The shipped detector knows the objects of the houses; other manifests name their own detections.
PIPELINE ?= pipelines/$(if $(filter house_%,$(notdir $(MANIFEST))),robot17_3x16,default).toml
WORKERS  ?= 1
# Houses rendered at a time.
SIM_WORKERS ?= 2
ARGS     ?=

BIN       := $(VENV)/bin
INSTALLED := $(VENV)/.installed
DEV       := $(VENV)/.installed-dev
STAGES    := index poses detect lift fuse score report
TABLE1    := robot17_noview robot17_3x16 robot17_3x8
POSES     := house_test house_test_true

.DEFAULT_GOAL := all
.PHONY: all table1 install dev test check lint bench clean simulate $(STAGES)

all: install simulate
	$(BIN)/imodbatch run $(MANIFEST) --pipeline $(PIPELINE) --workers $(WORKERS) $(ARGS)

$(STAGES): install simulate
	$(BIN)/imodbatch $@ $(MANIFEST) --pipeline $(PIPELINE) $(ARGS)

# The embedded datasets are generated, not stored; nothing happens when they are already there.
simulate: install
ifneq ($(filter house_test%,$(notdir $(MANIFEST))),)
	@$(BIN)/imodbatch simulate data/house_test --world house --split test --workers $(SIM_WORKERS)
else ifneq ($(filter house_val%,$(notdir $(MANIFEST))),)
	@$(BIN)/imodbatch simulate data/house_val --world house --split val --worlds 3 \
	  --workers $(SIM_WORKERS)
else ifeq ($(notdir $(MANIFEST)),analytic.toml)
	@$(BIN)/imodbatch simulate data/analytic
endif

# The runs with true poses take over the tables that do not depend on poses. A table carries what it
# was made from, so a copy that does not fit is redone like any other.
table1: install
	@$(BIN)/imodbatch simulate data/house_test --world house --split test --workers $(SIM_WORKERS)
	@set -e; for pipeline in $(TABLE1); do \
	  odometry=runs/house_test--$$pipeline; exact=runs/house_test_true--$$pipeline; \
	  $(BIN)/imodbatch run manifests/house_test.toml --pipeline pipelines/$$pipeline.toml \
	    --workers $(WORKERS) $(ARGS); \
	  mkdir -p $$exact; \
	  for table in frames annotations detections; do cp -R $$odometry/$$table $$exact/; done; \
	  $(BIN)/imodbatch run manifests/house_test_true.toml --pipeline pipelines/$$pipeline.toml \
	    --workers $(WORKERS) $(ARGS); \
	done
	@set -e; for poses in $(POSES); do \
	  $(BIN)/imodbatch compare manifests/$$poses.toml $(TABLE1:%=pipelines/%.toml) \
	    --out runs/table1--$$poses; \
	done

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
