# Two commands: `make report` runs the main job, `make test` runs the tests. Both set themselves up.
PYTHON ?= python3
BIN := .venv/bin

STUDIES := $(patsubst studies/%/__main__.py,%,$(wildcard studies/*/__main__.py))

.PHONY: report studies test test-all test-matrix test-random fuzz lint bench notebooks lock clean

.venv/ready: pyproject.toml requirements.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed; set PYTHON=...")'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@

report: .venv/ready
	$(BIN)/hfa report --folder report --claims docs/results/claims.json

# Every study of the folder studies/, one after the other; results go to out/NAME.
studies: .venv/ready
	@for name in $(STUDIES); do echo "studies.$$name"; $(BIN)/python -m studies.$$name || exit 1; done

test: .venv/ready
	$(BIN)/python -m pytest -m "not slow"

test-all: .venv/ready
	$(BIN)/python -m pytest

# The files, and the tests of each, in ORDERS random orders, to the first with a failure: those of SEED, SEED + 1, ...
# Which were tried, and what came of it, stays in out/orders.
ORDERS ?= 1
SEED := $(or $(SEED),$(shell date +%s))
TESTS ?= tests
test-random: .venv/ready
	@mkdir -p out
	@for seed in $$(seq $(SEED) $$(($(SEED) + $(ORDERS) - 1))); do \
		said=failed; $(BIN)/python -m pytest -m "not slow" --no-loadscope-reorder --order $$seed $(TESTS) && said=passed; \
		echo "SEED=$$seed TESTS=$(TESTS): $$said, $$(git describe --always --dirty)" | tee -a out/orders; \
		[ $$said = passed ] || exit 1; \
	done

# Hostile inputs by every way in, continued where the last run was left; atheris guides them where it installs.
FUZZ_INPUTS ?= 100000
FUZZ_SECONDS ?= 3600
fuzz: .venv/ready
	-$(BIN)/python -m pip install --quiet --disable-pip-version-check atheris
	OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/support/fuzz.py --inputs $(FUZZ_INPUTS) --seconds $(FUZZ_SECONDS)

# The oldest and the newest versions of the dependencies, with every Python that is found (PYTHONS names them).
PYTHONS ?=
test-matrix: .venv/ready
	$(BIN)/python tests/support/matrix.py $(PYTHONS)

lint: .venv/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo

# The peers of the benchmarks stay out of the lock: nothing else needs them.
bench: .venv/ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps -r benchmarks/requirements.txt
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks

# Executes the notebooks and stores their outputs in them.
notebooks: .venv/ready
	$(BIN)/python tests/support/notebooks.py

# Rewrites the exact versions from the lower bounds in pyproject.toml.
lock:
	rm -rf .venv-lock && $(PYTHON) -m venv .venv-lock
	.venv-lock/bin/python -m pip install --quiet --disable-pip-version-check "setuptools>=68" ".[dev]"
	.venv-lock/bin/python -m pip freeze --all --exclude pip --exclude hfa-toolchain > requirements.lock
	rm -rf .venv-lock

clean:
	rm -rf .venv report
