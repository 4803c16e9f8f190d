# Set-up, main job, tests and checks. `make run` and `make test` are all a fresh machine needs.

PYTHON ?= python3
VENV ?= .venv
ZOO ?=
STEPS ?= 600k
START ?= embedded:kick-and-defend/adversary/v1
BIN := $(VENV)/bin
SOURCES := apil_core envs plugins examples tests benchmarks docs
# Example plugins as anybody else's: packages of their own, installed beside the core.
EXAMPLES := $(patsubst %/pyproject.toml,%,$(wildcard examples/*/pyproject.toml))

.PHONY: run test test-slow test-templates test-wheel check docs check-pythons format clean

# The environment is rebuilt whenever its inputs change.
$(VENV)/.ready: pyproject.toml constraints.txt $(EXAMPLES:%=%/pyproject.toml)
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "APIL needs Python 3.11 or newer, $(PYTHON) is " + sys.version.split()[0] + ": make PYTHON=python3.11")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet -c constraints.txt -e '.[dev]' $(EXAMPLES:%=-e %)
	@touch $@

# Main job: E-APIL against the kicker, its score beside the game's own keeper's, its learning curve and a film of a game
# it wins. It starts as a clone of the shipped adversary; `START= STEPS=1500k` trains from scratch. The kicker is the
# student shipped with the package, or the zoo's own agent once it was imported, which ZOO=DIR does first.
run: $(VENV)/.ready
	$(if $(ZOO),$(BIN)/apil victims import "$(ZOO)")
	$(BIN)/apil run --method e_apil --env kick-and-defend --preset efficient --physics fast --steps $(STEPS) $(if $(START),--init-from $(START)) --show $(FLAGS)

test: $(VENV)/.ready
	$(BIN)/python -m pytest -n 2 --dist worksteal $(FLAGS)

# Minutes of physics: 1000 games between zoo agents and the like.
test-slow: $(VENV)/.ready
	$(BIN)/python -m pytest -m slow $(FLAGS)

# What `apil new` writes, installed into a fresh environment, tested and run there.
test-templates: $(VENV)/.ready
	$(BIN)/python -m pytest -m slow tests/scaffold $(FLAGS)

# The built wheel, in an environment that has nothing else: are all files in it, all dependencies named?
test-wheel: $(VENV)/.ready
	$(BIN)/python -m pytest -m slow tests/wheel $(FLAGS)

check: $(VENV)/.ready
	$(BIN)/ruff format --check $(SOURCES)
	$(BIN)/ruff check $(SOURCES)
	$(BIN)/mypy

# The documentation site, into site/; any broken link or missing page is an error. `python -m http.server -d site` shows it.
docs: $(VENV)/.ready
	$(BIN)/python docs/site/build_site.py $(FLAGS)

# Whether all that is needed exists as wheels for every Python we name; installs only the tool that asks, uv.
check-pythons: $(VENV)/.ready
	$(BIN)/python -m pip install --quiet uv
	@for version in 3.11 3.12 3.13; do \
	  $(BIN)/uv pip compile --quiet --upgrade --python-version $$version --only-binary :all: --extra dev \
	    -c constraints.txt -o $(VENV)/python-$$version.txt pyproject.toml || exit 1; \
	  echo "Python $$version: $(VENV)/python-$$version.txt"; \
	done

format: $(VENV)/.ready
	$(BIN)/ruff format $(SOURCES)
	$(BIN)/ruff check --fix $(SOURCES)

clean:
	rm -rf $(VENV) .pytest_cache .mypy_cache .ruff_cache
