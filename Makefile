# Two commands: `make report` runs the main job, `make test` runs the tests. Both set themselves up.
PYTHON ?= python3
BIN := .venv/$(if $(filter Windows_NT,$(OS)),Scripts,bin)

.PHONY: report pictures docs test test-core test-blas coverage test-all mutants test-matrix fuzz lint bench notebooks lock clean

.venv/report: pyproject.toml tools/requirements-report.lock
	@$(PYTHON) tools/check_python.py
	@echo "Installing the $$(grep -c == tools/requirements-report.lock) packages that the report needs into .venv"
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --disable-pip-version-check --require-hashes -r tools/requirements-report.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@

.venv/tests: .venv/report tools/requirements-test.lock
	@echo "Installing the $$(grep -c == tools/requirements-test.lock) packages that the tests need into .venv"
	$(BIN)/python -m pip install --disable-pip-version-check --require-hashes -r tools/requirements-test.lock
	@touch $@

.venv/ready: .venv/tests tools/requirements.lock
	@echo "Installing the $$(grep -c == tools/requirements.lock) packages of documents, linters and other tools into .venv"
	$(BIN)/python -m pip install --disable-pip-version-check --require-hashes -r tools/requirements.lock
	@touch $@

report: .venv/report
	$(BIN)/hfa report -o report --flights studies/best_flights/results
	@echo "To put the command hfa on the PATH, type: source $(BIN)/activate"

# Every stored picture of the documents anew; those of the page and of sheets need the browser Chromium and pdftoppm.
# docs/pictures/NAME has those that the commands of docs/NAME.md draw.
pictures: .venv/ready
	$(BIN)/hfa report -o report --flights studies/best_flights/results
	cp report/regeneration.png report/root_locus.png docs/pictures
	$(BIN)/python tools/draw_pictures.py
	chromium --headless --no-sandbox --hide-scrollbars --window-size=1400,900 --virtual-time-budget=10000 \
		--screenshot=docs/pictures/page.png file://$(CURDIR)/report/report.html
	$(BIN)/hfa trim -q --aircraft examples/uav.toml -o report/sheet.html
	$(BIN)/hfa trim -q --aircraft examples/uav.toml -o report/sheet.pdf
	chromium --headless --no-sandbox --hide-scrollbars --window-size=1100,1130 \
		--screenshot=docs/pictures/sheet_html.png file://$(CURDIR)/report/sheet.html
	pdftoppm -r 90 -png -f 1 -l 1 -singlefile report/sheet.pdf docs/pictures/sheet_pdf
	$(BIN)/hfa trim -q --aircraft examples/uav.toml --conditions examples/uav_conditions.csv --document "TR-12, revision B" -o report/book.pdf
	pdftoppm -r 70 -png -f 1 -l 1 -singlefile report/book.pdf docs/pictures/book_cover
	pdftoppm -r 100 -png -f 2 -l 2 -singlefile report/book.pdf docs/pictures/book_matrix
	$(BIN)/python tools/shrink_pictures.py $(addprefix docs/pictures/,page.png sheet_html.png sheet_pdf.png book_cover.png book_matrix.png)

.venv-docs/ready: pyproject.toml tools/requirements-docs.lock
	@echo "Installing the $$(grep -c == tools/requirements-docs.lock) packages that the documents need into .venv-docs"
	$(PYTHON) -m venv .venv-docs
	.venv-docs/bin/python -m pip install --disable-pip-version-check --require-hashes -r tools/requirements-docs.lock
	.venv-docs/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@

# The documentation as a site of HTML pages; opens without a network. Its environment is .venv-docs: .venv stays as it is.
docs: .venv-docs/ready
	@echo "Writing the pages of commands and public names, then the site: a minute or two"
	.venv-docs/bin/python -m sphinx -W -n -q docs site
	@echo "wrote site/index.html"

test: .venv/tests
	$(BIN)/python -m pytest -m "not slow"

# The tests of the core where no extension is installed.
test-core: .venv/tests
	$(BIN)/python tests/core_alone.py

# The fast tests with the BLAS kernels of five kinds of processors, one after the other: no answer depends on the processor.
KERNELS := Haswell Zen SkylakeX Sandybridge Nehalem
test-blas: .venv/tests
	@for kernel in $(KERNELS); do \
		echo "OPENBLAS_CORETYPE=$$kernel"; \
		OPENBLAS_CORETYPE=$$kernel $(BIN)/python -m pytest -q -m "not slow" || exit 1; \
	done

# The lines that no fast test reaches, as a table and as pages in out/coverage.
coverage: .venv/tests
	$(BIN)/python -m pip install --quiet --disable-pip-version-check pytest-cov
	$(BIN)/python -m pytest -m "not slow" --cov --cov-report=term:skip-covered --cov-report=html:out/coverage

# Files of long tests would wait behind each other: a worker without work takes tests of the others.
test-all: .venv/ready test-core
	$(BIN)/python -m pytest --dist worksteal

# Plants random errors in a folder of source and lists those that its own fast tests do not catch.
ROOM ?= trim/linear
ERRORS ?= 60
SEED ?= 1
mutants: .venv/tests
	$(BIN)/python tools/plant_errors.py $(ROOM) --count $(ERRORS) --seed $(SEED)

# Many hostile command lines and files; the tests draw a few.
EXAMPLES ?= 500
fuzz: .venv/tests
	EXAMPLES=$(EXAMPLES) $(BIN)/python -m pytest $$(grep -rl "^from hypothesis import" tests extensions --include=test_*.py)

# The oldest and the newest versions of the dependencies, with every Python that is found.
test-matrix: .venv/ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check nox
	$(BIN)/nox

lint: .venv/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo

bench: .venv/ready
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks

# Executes the notebooks and stores their outputs in them, without times.
notebooks: .venv/ready
	$(BIN)/python tools/execute_notebooks.py examples/*.ipynb

# Rewrites the exact versions, with the hashes of their files, from the lower bounds in pyproject.toml: of everything, then
# of what documents, tests and the report need. Takes minutes.
COMPILE = .venv-lock/bin/pip-compile --quiet --generate-hashes --allow-unsafe --strip-extras --no-header --no-annotate \
	--no-emit-index-url --no-emit-trusted-host --no-emit-find-links --build-deps-for wheel
lock:
	rm -rf .venv-lock && $(PYTHON) -m venv .venv-lock
	.venv-lock/bin/python -m pip install --quiet --disable-pip-version-check pip-tools
	$(COMPILE) --upgrade --extra dev --extra docs --extra test -o tools/requirements.lock pyproject.toml
	$(COMPILE) --upgrade -c tools/requirements.lock --extra docs -o tools/requirements-docs.lock pyproject.toml
	$(COMPILE) --upgrade -c tools/requirements.lock --extra test -o tools/requirements-test.lock pyproject.toml
	$(COMPILE) --upgrade -c tools/requirements.lock --extra page -o tools/requirements-report.lock pyproject.toml
	rm -rf .venv-lock

clean:
	rm -rf .venv .venv-docs report site docs/generated
