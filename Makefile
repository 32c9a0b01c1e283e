# make run, make test: all the set-up there is. Everything is installed into .venv, at the
# versions in constraints.txt.
PYTHON ?= python3
BIN := .venv/bin
PRESETS := makse-stratification makse-segregation glass-sugar lattice-stratification
KERNELS := $(wildcard ca_model/*.py ca_model/*/*.py continuum/*.py)

.PHONY: run test lint bench giant killed picture lock clean

run: .venv/.run .venv/.kernels
	@$(MAKE) --no-print-directory -j2 --output-sync $(PRESETS:%=pour/%)
	@$(BIN)/stratify compare --force $(PRESETS:%=pours/%)

pour/%:
	@echo "$*" && $(BIN)/stratify pour $* -o pours/$* --force

test: .venv/.test .venv/.kernels lint
	@$(BIN)/pytest

# A thousand processes that pour are killed, each in its turn; some minutes.
killed: .venv/.test .venv/.kernels
	@STRATIFY_KILLS=1000 $(BIN)/pytest -s tests/test_killed.py

lint: .venv/.test
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy

bench: .venv/.bench .venv/.kernels
	@$(BIN)/python -m benchmarks

# 10^5 columns and 10^9 grains, some minutes; pours/giant.nc and its picture.
giant: .venv/.bench .venv/.kernels
	@$(BIN)/python -m benchmarks giant

# The README's picture, from the archives of `make run`.
picture: run
	@cp pours/glass-sugar/comparison.png docs/glass-sugar.png

.venv/.run: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --constraint constraints.txt --editable .
	@touch $@

.venv/.test: .venv/.run
	$(BIN)/pip install --quiet --constraint constraints.txt --editable ".[cluster,photo,test,zarr]"
	@touch $@

.venv/.bench: .venv/.test
	$(BIN)/pip install --quiet --constraint constraints.txt --editable ".[bench]"
	@touch $@

# A cached kernel does not notice that a function it calls in another file has changed.
.venv/.kernels: .venv/.run $(KERNELS)
	@find ca_model continuum \( -name '*.nbc' -o -name '*.nbi' \) -delete
	@touch $@

# Newest versions that fit together; commit what it writes.
lock:
	rm -rf .venv && $(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --editable ".[bench,cluster,photo,test,zarr]"
	$(BIN)/pip freeze --exclude-editable > constraints.txt

clean:
	rm -rf .venv pours
