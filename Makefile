# Two commands do everything: `make all` and `make test`. Neither needs root or a GPU.
#
#   make all  [MANIFEST=x] [PIPELINE=y] [WORKERS=2]      shipped ones by name, your own by path
#   make table1                     three detectors on simulated houses: the paper's Table 1
#   make table2 [MANIFEST=…]        two detectors on simulated tables, or on the UW RGB-D Scenes
#                                   (rgbd_scenes_v1): the paper's Table 2
#   make index | poses | detect | lift | fuse | score | diagnose | report      one stage
#   make test | check | bench | mutants | clean

PYTHON   ?= python3
VENV     ?= .venv
MANIFEST ?= house_test
WORKERS  ?= 1
ARGS     ?=

BIN       := $(VENV)/bin
INSTALLED := $(VENV)/.installed
DEV       := $(VENV)/.installed-dev
# Without PIPELINE a manifest's own.
PIPED      = $(if $(PIPELINE),--pipeline $(PIPELINE))
STAGES    := index poses detect lift fuse score diagnose report
TABLE1    := robot17_noview robot17_3x16 robot17_3x8
POSES     := house_test house_test_true
TABLE2    := rgbd5_noview rgbd5_3x12
SCENES     = $(basename $(notdir $(MANIFEST)))

.DEFAULT_GOAL := all
.PHONY: all table1 table2 install dev test check lint bench mutants clean $(STAGES)

all: install
	$(BIN)/imodbatch run $(MANIFEST) $(PIPED) --workers $(WORKERS) $(ARGS)

$(STAGES): install
	$(BIN)/imodbatch $@ $(MANIFEST) $(PIPED) $(ARGS)

# The runs with true poses take over the tables that do not depend on poses. A table carries what it
# was made from, so a copy that does not fit is redone like any other.
table1: install
	@set -e; for pipeline in $(TABLE1); do \
	  odometry=runs/house_test--$$pipeline; exact=runs/house_test_true--$$pipeline; \
	  $(BIN)/imodbatch run house_test --pipeline $$pipeline --workers $(WORKERS) $(ARGS); \
	  mkdir -p $$exact; \
	  for table in frames annotations detections; do cp -R $$odometry/$$table $$exact/; done; \
	  $(BIN)/imodbatch run house_test_true --pipeline $$pipeline --workers $(WORKERS) $(ARGS); \
	done
	@set -e; for poses in $(POSES); do \
	  $(BIN)/imodbatch compare $$poses $(TABLE1) --out runs/table1--$$poses; \
	done

ifeq ($(origin MANIFEST),file)
table2: MANIFEST = scenes_test
endif
# The second run takes over the tables that no detector changes, so poses are estimated once.
table2: install
	@set -e; for pipeline in $(TABLE2); do \
	  first=runs/$(SCENES)--$(firstword $(TABLE2)); run=runs/$(SCENES)--$$pipeline; \
	  if [ $$run != $$first ]; then \
	    mkdir -p $$run; \
	    for table in frames annotations poses pose_quality reference_poses; do \
	      cp -R $$first/$$table $$run/; \
	    done; \
	  fi; \
	  $(BIN)/imodbatch run $(MANIFEST) --pipeline $$pipeline --out $$run --workers $(WORKERS) \
	    $(ARGS); \
	done
	@$(BIN)/imodbatch compare $(TABLE2:%=runs/$(SCENES)--%) --table 2 --out runs/table2

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

mutants: dev
	$(BIN)/python tests/benchmarks/mutants.py

install: $(INSTALLED)
dev: $(DEV)

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Python 3.11 or newer is needed; name one: make PYTHON=python3.12"; exit 1; }
	@$(PYTHON) -m venv $(VENV) 2>/dev/null || $(PYTHON) -m virtualenv -q $(VENV) 2>/dev/null || \
	  { rm -rf $(VENV); echo "No venv module. Debian: apt install python3-venv, or without root:" \
	    "$(PYTHON) -m pip install --user virtualenv"; exit 1; }

$(INSTALLED): pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[lab]'
	@touch $@

$(DEV): pyproject.toml $(INSTALLED)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@

clean:
	rm -rf runs data .mypy_cache .pytest_cache .ruff_cache
