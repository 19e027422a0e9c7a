# make demo [VIEW=1] · make test · make bench · make fuzz · make alarms: each installs what it needs
# into .venv first.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: demo test check unit process bench fuzz alarms lock clean

# The installation is a file target: it is made anew when a lock or the project file changes.
$(VENV)/run: requirements-sim.lock pyproject.toml
	$(PYTHON) -m venv --clear $(VENV)
	$(BIN)/pip install --quiet --require-hashes -r requirements-sim.lock
	$(BIN)/pip install --quiet --no-deps --no-build-isolation --editable .
	touch $@

$(VENV)/dev: $(VENV)/run requirements-dev.lock
	$(BIN)/pip install --quiet --require-hashes -r requirements-dev.lock
	touch $@

demo: $(VENV)/run
	$(BIN)/wackel demo $(if $(VIEW),--view)

test: check unit process

check: $(VENV)/dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/wackel schema --check schemas/json

# On all processors; the tests of a module share what is set up for them.
unit: $(VENV)/dev
	$(BIN)/pytest -q -n auto --dist loadfile -m "not process"

process: $(VENV)/dev
	$(BIN)/pytest -q -n auto --dist loadfile -m "process and not alone"
	$(BIN)/pytest -q -m "process and alone"

bench: $(VENV)/dev
	$(BIN)/python -m tests.bench

fuzz: $(VENV)/dev
	$(BIN)/python -m tests.fuzz

# Simulated driving without a fault, in all runs of the same code together; Ctrl-C keeps it.
HOURS ?= 300
alarms: $(VENV)/dev
	$(BIN)/python -m tests.bench.alarms --hours $(HOURS)

# Renew the locks; review the difference before committing it. A robot needs requirements.lock only.
PIP_COMPILE := $(BIN)/pip-compile --quiet --generate-hashes --allow-unsafe --strip-extras \
	--no-emit-index-url --no-emit-find-links --extra build
lock: $(VENV)/dev
	$(PIP_COMPILE) -o requirements.lock pyproject.toml
	$(PIP_COMPILE) --extra sim -o requirements-sim.lock pyproject.toml
	$(PIP_COMPILE) --extra sim --extra dev -o requirements-dev.lock pyproject.toml

clean:
	rm -rf $(VENV)
