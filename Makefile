# PointTrackNet: `make demo` shows it, `make test` proves it. See README.md.
PYTHON ?= python3
VENV   := .venv
PY     := $(VENV)/bin/python
STAMP  := $(VENV)/requirements.stamp
CUDA   := $(VENV)/cuda.stamp
PYTEST_FLAGS ?= -n 2 --dist worksteal
CLANG_FORMAT := $(VENV)/bin/clang-format
CPP = $(wildcard tf_ops/*/*.cc tf_ops/*/*.h)

.DEFAULT_GOAL := all
.PHONY: all venv ops clean-ops bench sanitize weights demo fuzz kill test test-fast lint format clean

all: venv ops

venv: $(STAMP) $(if $(GPU),$(CUDA))

$(STAMP): requirements.txt requirements-lock.txt
	@"$(PYTHON)" -c 'import sys; v = sys.version_info[:2]; (3, 10) <= v <= (3, 13) or \
	    sys.exit("make: Python 3.10 to 3.13 is needed, $(PYTHON) is %d.%d; try make PYTHON=python3.12" % v)'
	@$(PY) -m pip --version >/dev/null 2>&1 || "$(PYTHON)" -m venv $(VENV) || \
	    { echo 'make: no $(VENV); on Debian and Ubuntu: sudo apt install python3-venv' >&2; exit 1; }
	$(PY) -m pip install --quiet --disable-pip-version-check -r requirements.txt
	@touch $@

# GPU=1: the CUDA libraries of TensorFlow's own choice (docs/TRAINING.md)
$(CUDA): $(STAMP)
	$(PY) -m pip install --quiet --disable-pip-version-check -r requirements.txt 'tensorflow[and-cuda]'
	@touch $@

ops: $(STAMP) | $(filter clean-ops,$(MAKECMDGOALS))
	@$(MAKE) --no-print-directory -C tf_ops PYTHON="$(CURDIR)/$(PY)" $(if $(NATIVE),NATIVE=$(NATIVE))

clean-ops:
	@$(MAKE) --no-print-directory -C tf_ops clean

demo: ops
	$(PY) demo.py $(DEMO_FLAGS)

# LABELS=DIR: KITTI's labels drive simulated traffic; SCANS=DIR: real labelled scans (docs/TRAINING.md)
weights: ops
	$(PY) -m training.recipe $(if $(LABELS),--labels "$(LABELS)") $(if $(SCANS),--scans "$(SCANS)") $(WEIGHTS_FLAGS)

bench: ops
	$(PY) -m pip install --quiet --disable-pip-version-check -r requirements-bench.txt
	$(PY) -m tf_ops.bench table
	$(PY) -m tf_ops.bench growth
	$(PY) -m tf_ops.bench readme

sanitize: $(STAMP)
	@$(MAKE) --no-print-directory -C tf_ops PYTHON="$(CURDIR)/$(PY)" sanitize

test: ops
	$(PY) -m pytest $(PYTEST_FLAGS)

fuzz: ops
	PYTHONPATH=.:tests TF_CPP_MIN_LOG_LEVEL=3 $(PY) -m campaigns.fuzz --n $(or $(N),20000) --seed $(or $(SEED),0)

kill: ops
	PYTHONPATH=.:tests $(PY) -m campaigns.kill --n $(or $(N),30) --seed $(or $(SEED),0)

test-fast: ops
	$(PY) -m pytest $(PYTEST_FLAGS) -m "not slow"

lint: $(STAMP)
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(CLANG_FORMAT) --dry-run --Werror $(CPP)

format: $(STAMP)
	$(PY) -m ruff check --fix .
	$(PY) -m ruff format .
	$(CLANG_FORMAT) -i $(CPP)

clean: clean-ops
	rm -rf $(VENV) .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
