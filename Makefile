# Set-up, main job, tests and checks. `make run` and `make test` are all a fresh machine needs.

PYTHON ?= python3
VENV ?= .venv
ZOO ?= ../shared/zoo/agent-zoo
STEPS ?= 100k
BIN := $(VENV)/bin
SOURCES := apil_core envs plugins examples tests benchmarks docs

.PHONY: run test test-slow check format clean

# The environment is rebuilt whenever its inputs change.
$(VENV)/.ready: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "APIL needs Python 3.11 or newer, $(PYTHON) is " + sys.version.split()[0] + ": make PYTHON=python3.11")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet -c constraints.txt -e '.[dev]'
	@touch $@

# Main job: E-APIL against the published kicker, then its score. Victims found in ZOO are imported first.
run: $(VENV)/.ready
	@if [ -d "$(ZOO)" ]; then $(BIN)/apil victims import "$(ZOO)"; fi
	$(BIN)/apil run --method e_apil --env kick-and-defend --preset quick --steps $(STEPS) $(FLAGS)

test: $(VENV)/.ready
	$(BIN)/python -m pytest -n 2 --dist worksteal $(FLAGS)

# Minutes of physics: 1000 games between zoo agents and the like.
test-slow: $(VENV)/.ready
	$(BIN)/python -m pytest -m slow $(FLAGS)

check: $(VENV)/.ready
	$(BIN)/ruff format --check $(SOURCES)
	$(BIN)/ruff check $(SOURCES)
	$(BIN)/mypy

format: $(VENV)/.ready
	$(BIN)/ruff format $(SOURCES)
	$(BIN)/ruff check --fix $(SOURCES)

clean:
	rm -rf $(VENV) .pytest_cache .mypy_cache .ruff_cache
