# A fresh machine needs two commands: `make demo` and `make test`. Everything else is in reach of `make help`.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
SOURCES := pyproject.toml CMakeLists.txt README.md $(shell find src cpp web -type f \
	-not -path '*/node_modules/*' -not -path '*/static/*' -not -name '*.so' -not -name '*.pyc' -not -name '_core.pyi')
export PIP_DISABLE_PIP_VERSION_CHECK := 1
export PIP_NO_INPUT := 1
export PYTHONNOUSERSITE := 1
unexport PYTHONPATH

.PHONY: help demo test mutate fuzz lint bench wheel tools clean
help:
	@echo "make demo    set up, then X-ray counts to an organ in the browser"
	@echo "make test    set up, then the tests against the built wheel"
	@echo "make mutate  set up, then 5,000 damaged files, none of which may crash a reader (MUTANTS=\"9000 --seed 2\")"
	@echo "make fuzz    set up, then 100,000 random messages to the server (MESSAGES=\"9000 --seed 2\")"
	@echo "make lint    ruff, strict mypy and clang-format over the built wheel and the sources"
	@echo "make bench   set up with the peers, then every benchmark; on an otherwise idle machine"
	@echo "make wheel   the wheel alone, in dist/"
	@echo "make clean   remove what the others made"

demo: $(VENV)/installed
	$(BIN)/palpate demo $(DEMO)

test: $(VENV)/tested-with
	$(BIN)/python -m pytest $(PYTEST)

mutate: $(VENV)/tested-with
	$(BIN)/python tests/mutations.py $(MUTANTS)

fuzz: $(VENV)/tested-with
	$(BIN)/python tests/fuzz.py $(MESSAGES)

lint: $(VENV)/linted-with
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/clang-format --dry-run --Werror cpp/*.cpp cpp/*.h
	$(BIN)/mypy -p palpate

bench: $(VENV)/benched-with
	$(BIN)/python -m benchmarks $(PARTS)

wheel: dist/built

# Says what a bare Debian lacks, all of it at once, before anything is downloaded.
tools:
	@PYTHON=$(PYTHON) sh .ci/tools

dist/built: $(SOURCES) | tools $(VENV)/made
	rm -rf dist && mkdir dist
	$(BIN)/pip wheel --quiet --no-deps --wheel-dir dist .
	touch $@

$(VENV)/made: | tools
	$(PYTHON) -m venv $(VENV)
	touch $@

$(VENV)/installed: dist/built
	$(BIN)/pip install --quiet --upgrade --upgrade-strategy only-if-needed dist/*.whl
	$(BIN)/pip install --quiet --no-deps --force-reinstall dist/*.whl
	touch $@

$(VENV)/tested-with: $(VENV)/installed
	$(BIN)/pip install --quiet "$$(ls dist/*.whl)[test]"
	touch $@

$(VENV)/linted-with: $(VENV)/installed
	$(BIN)/pip install --quiet "$$(ls dist/*.whl)[lint]"
	touch $@

$(VENV)/benched-with: $(VENV)/installed
	$(BIN)/pip install --quiet "$$(ls dist/*.whl)[bench]"
	touch $@

clean:
	rm -rf $(VENV) dist build demo .mypy_cache .ruff_cache .pytest_cache .hypothesis
