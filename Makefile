# make run, make test: all the set-up there is. Everything is installed into .venv, at the
# versions in constraints.txt.
PYTHON ?= python3
BIN := .venv/bin
PRESETS := makse-stratification makse-segregation glass-sugar lattice-stratification
KERNELS := $(wildcard ca_model/*.py ca_model/*/*.py continuum/*.py experiment/*.py compare/*/kernel.py)

# Set-ups of the phase diagrams: 10 records for each L / v; on the lattice columns of 10 small grains,
# of 5 units to 11 (3, 8 and 16), whose slopes come in single units, not in steps of a grain.
MAKSE := makse-segregation --set "title=Makse 1997, section V" --set continuum.cells=200 \
	--set ca_model.column_width=0.6666666666666666 --set ca_model.unit=0.012346 \
	--set ca_model.arrivals=drawn
TERNARY := ternary --set mixture.theta_33=1.0 --set mixture.psi=0.15 --set pour.records=600 \
	--set ca_model.column_width=0.15 --set ca_model.unit=0.005 --set ca_model.arrivals=drawn
# By the rate rule, grains small enough to be near the continuum, on columns as wide as its cells.
GRAINS := makse-segregation --rule rate --set "title=Makse 1997, section V, by the rate rule" \
	--set continuum.cells=200 --set ca_model.column_width=0.5 --set pour.records=300 \
	--set "mixture.grain_diameter=[0.0020833333333333333,0.004166666666666667]"
DELTA := --vary mixture.delta=-0.3:0.5:33
FIGURES := angles functions profiles onset phase
BRIDGE := limit between grains
DIAGRAMS := delta-psi delta-psi-rate delta-cross_rate delta-flux delta-composition ternary

.PHONY: run test lint bench giant killed picture figures diagrams bridge validation notebooks docs lock clean

run: .venv/.run .venv/.kernels
	@$(MAKE) --no-print-directory -j2 --output-sync $(PRESETS:%=pour/%)
	@$(BIN)/stratify compare --force $(PRESETS:%=pours/%)

pour/%:
	@echo "$*" && $(BIN)/stratify pour $* -o pours/$* --force

test: .venv/.test .venv/.kernels lint
	@$(BIN)/pytest --numprocesses auto --dist loadfile

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

# The figures of the paper, drawn from the code; a minute or two.
figures: $(FIGURES:%=figure/%)

figure/%: .venv/.run .venv/.kernels
	@$(BIN)/stratify figure $* -o docs/figures --force

# The models held against all that is known on paper; docs/validation.md, a minute.
validation: .venv/.run .venv/.kernels
	@$(BIN)/stratify validate -o docs/validation.md --force

# The notebooks, run in place: their outputs are kept in them.
notebooks: .venv/.test .venv/.kernels
	@$(BIN)/python notebooks/execute.py

# The phase diagrams of docs/phase-diagrams.md, in pours/; pictures and numbers go to docs/.
diagrams: $(DIAGRAMS:%=diagram/%)

diagram/delta-psi: MAP = $(MAKSE) --set pour.records=300 $(DELTA) --vary mixture.psi=0.02:0.5:25
diagram/delta-psi-rate: MAP = $(GRAINS) --vary mixture.delta=-0.3:0.2:21 \
	--vary mixture.psi=0.02:0.5:13
diagram/delta-cross_rate: MAP = $(MAKSE) --set pour.records=300 $(DELTA) \
	--vary mixture.cross_rate=0.01:2:21:log --model continuum
diagram/delta-flux: MAP = $(MAKSE) --set pour.duration=6000.0 --set pour.records=600 $(DELTA) \
	--vary feed.total_inflow=0.25:4:17:log
diagram/delta-composition: MAP = $(MAKSE) --set pour.records=300 $(DELTA) \
	--vary feed.share_2=0.05:0.95:19
diagram/ternary: MAP = $(TERNARY) --vary mixture.theta_11=0.5:1.5:21 \
	--vary mixture.theta_22=0.5:1.5:21 --lines 0

diagram/%: .venv/.run .venv/.kernels
	@mkdir -p pours/diagrams docs/diagrams
	@echo "$*" && $(BIN)/stratify phase $(MAP) -o pours/diagrams/$*.nc --force --json > pours/diagrams/$*.json
	@cp pours/diagrams/$*.png pours/diagrams/$*.json docs/diagrams/

# The studies of docs/bridge.md, in pours/bridge; pictures and numbers go to docs/. Minutes each.
bridge: $(BRIDGE:%=bridge/%)

bridge/%: .venv/.run .venv/.kernels
	@mkdir -p pours/bridge docs/bridge
	@$(BIN)/stratify bridge $* --seeds 6 -o pours/bridge --force --json > pours/bridge/$*.json
	@cp pours/bridge/$*.png pours/bridge/$*.json docs/bridge/

# The documentation, into docs/_build/html; needs no network.
docs: .venv/.test
	@$(BIN)/sphinx-build -W --keep-going -n -q docs docs/_build/html
	@echo "docs/_build/html/index.html"

.venv/.run: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --constraint constraints.txt --editable .
	@touch $@

.venv/.test: .venv/.run
	$(BIN)/pip install --quiet --constraint constraints.txt --editable ".[cluster,docs,explore,film,photo,test,zarr]"
	@touch $@

.venv/.bench: .venv/.test
	$(BIN)/pip install --quiet --constraint constraints.txt --editable ".[bench]"
	@touch $@

# A cached kernel does not notice that a function it calls in another file has changed.
.venv/.kernels: .venv/.run $(KERNELS)
	@find ca_model compare continuum experiment \( -name '*.nbc' -o -name '*.nbi' \) -delete
	@touch $@

# Newest versions that fit together; commit what it writes.
lock:
	rm -rf .venv && $(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --editable ".[bench,cluster,docs,explore,film,photo,test,zarr]"
	$(BIN)/pip freeze --exclude-editable > constraints.txt

clean:
	rm -rf .venv pours docs/_build docs/_notebooks
