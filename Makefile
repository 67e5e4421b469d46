# A fresh machine needs two commands: `make demo` and `make test`. Everything else is in reach of `make help`.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
SOURCES := pyproject.toml CMakeLists.txt README.md $(shell find src cpp web -type f \
	-not -path '*/node_modules/*' -not -path '*/static/*' -not -name '*.so' -not -name '*.pyc' -not -path '*/_core/*')
export PIP_DISABLE_PIP_VERSION_CHECK := 1
export PIP_NO_INPUT := 1
export PYTHONNOUSERSITE := 1
unexport PYTHONPATH

.PHONY: help demo test test-cpp test-notebook test-neighbours test-torch cross test-aarch64 manylinux wasm mutate mutants fuzz fuzz-core cuts interrupt lint docs docs-figures bench wheel tools clean
help:
	@echo "make demo    set up, then X-ray counts to an organ in the browser"
	@echo "make test    set up, then the tests against the built wheel"
	@echo "make test-cpp  the kernels' own tests (needs cmake and doctest-dev; FOLDERS=\"base realtime\" SANITIZE=thread)"
	@echo "make cross   all kernels compiled by zig for aarch64 Linux, arm64 macOS and x86-64 Windows"
	@echo "make test-notebook  the widgets in a real JupyterLab and Chromium"
	@echo "make test-neighbours  the panels in a real napari, and ParaView if it is there (xvfb gives them a screen)"
	@echo "make test-torch  PyTorch's and DeepInverse's operations (a download of about 3 GB)"
	@echo "make test-aarch64  the kernels' own tests on an emulated aarch64 (needs cmake, doctest-dev,"
	@echo "             g++-aarch64-linux-gnu, qemu-user-static)"
	@echo "make manylinux  a wheel for Linux with glibc 2.28 or newer, compiled by zig, in build/manylinux/"
	@echo "make wasm    the engine of an exported page, compiled by zig into src/palpate/standalone/ (CHECK=--check: is it the committed one?)"
	@echo "make mutate  set up, then 1,300 files that lie, each to be refused in one line (HOSTILE=\"20 --seed 2\"), and 5,000"
	@echo "             damaged ones, none of which may crash a reader (MUTANTS=\"9000 --seed 2\")"
	@echo "make mutants  faults put into a copy of the last commit, which tests must notice (SEED=1 N=100)"
	@echo "make fuzz-core  set up, then 10,000 random calls of the core (CALLS=\"9000 --seed 2\")"
	@echo "make cuts    set up, then 10,000 random cuts, none of which may lose volume or leave a gap (CUTS=\"900 --seed 2\"),"
	@echo "             and the forces of 200 (FORCES=20)"
	@echo "make interrupt  set up, then 500 Ctrl-C, 200 kills, 100 full disks (INTERRUPT=\"--kills 20 --seed 2\")"
	@echo "make fuzz    set up, then 100,000 random messages to the server (MESSAGES=\"9000 --seed 2\")"
	@echo "make lint    ruff, strict mypy, clang-format and codespell over the built wheel and the sources"
	@echo "make docs    the site, in build/docs/: tutorials executed, API reference, links checked"
	@echo "make docs-figures  the measured figures that the site shows, from the tables of make bench"
	@echo "make bench   set up with the peers, then every benchmark; on an otherwise idle machine"
	@echo "make wheel   the wheel alone, in dist/"
	@echo "make clean   remove what the others made"

demo: $(VENV)/installed
	$(BIN)/palpate demo $(DEMO)

test: $(VENV)/tested-with
	$(BIN)/python -m pytest $(PYTEST)

# One program a folder of tests/cpp. GCC 12's thread sanitizer cannot map its memory where addresses are randomized widely.
FOLDERS ?= $(sort $(patsubst tests/cpp/%/,%,$(dir $(wildcard tests/cpp/*/test_*.cpp))))
cpp_build := build/cpp$(addprefix -,$(SANITIZE))
test-cpp:
	cmake -S . -B $(cpp_build) -DPALPATE_CPP_TESTS=ON -DPALPATE_SANITIZE=$(SANITIZE)
	cmake --build $(cpp_build) --parallel $$(nproc) --target $(addprefix test_,$(FOLDERS))
	for folder in $(FOLDERS); do $(if $(SANITIZE),setarch $$(uname -m) -R) $(cpp_build)/test_$$folder || exit 1; done

cross: $(VENV)/crossed-with
	$(BIN)/python .ci/cross-compile

test-notebook: $(VENV)/notebook-tested-with
	cd tests && $(abspath $(BIN)/python) -m pytest -n 0 page/test_jupyterlab.py

test-neighbours: $(VENV)/napari-tested-with
	cd tests && PALPATE_NEIGHBOURS=1 $$(command -v xvfb-run && echo -a) $(abspath $(BIN)/python) -m pytest -n 0 napari_plugin neighbours

test-torch: $(VENV)/torch-tested-with
	cd tests && $(abspath $(BIN)/python) -m pytest -n 0 differentiable

test-aarch64:
	cmake -S . -B build/aarch64 -DPALPATE_CPP_TESTS=ON -DCMAKE_SYSTEM_NAME=Linux -DCMAKE_SYSTEM_PROCESSOR=aarch64 \
		-DCMAKE_CXX_COMPILER=aarch64-linux-gnu-g++ -DCMAKE_CXX_FLAGS_RELEASE=-O1
	cmake --build build/aarch64 --parallel $$(nproc) --target $(addprefix test_,$(FOLDERS))
	for folder in $(FOLDERS); do qemu-aarch64-static -L /usr/aarch64-linux-gnu build/aarch64/test_$$folder || exit 1; done

manylinux: $(VENV)/crossed-with $(VENV)/tested-with
	PYTHON=$(abspath $(BIN)/python) ZIG_TARGET=x86_64-linux-gnu.2.28 LEVELS="$(LEVELS)" .ci/manylinux

wasm: $(VENV)/crossed-with
	$(BIN)/python .ci/wasm $(CHECK)

mutate: $(VENV)/tested-with
	$(BIN)/python tests/fuzz/hostile_files.py $(HOSTILE)
	$(BIN)/python tests/fuzz/mutated_files.py $(MUTANTS)

SEED ?= 1
N ?= 100
mutants: $(VENV)/tested-with
	cd tests && $(abspath $(BIN)/python) -m mutants --seed $(SEED) -n $(N)

fuzz: $(VENV)/tested-with
	$(BIN)/python tests/fuzz/server_messages.py $(MESSAGES)

fuzz-core: $(VENV)/tested-with
	$(BIN)/python tests/fuzz/core_calls.py $(CALLS)

cuts: $(VENV)/tested-with
	$(BIN)/python tests/fuzz/random_cuts.py $(CUTS)
	$(BIN)/python tests/fuzz/cut_forces.py $(FORCES)

interrupt: $(VENV)/tested-with
	$(BIN)/python tests/fuzz/interruptions.py $(INTERRUPT)

lint: $(VENV)/linted-with
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/clang-format --dry-run --Werror $$(git ls-files "cpp/*.cpp" "cpp/*.h" "tests/cpp/*.cpp" "tests/cpp/*.h")
	$(BIN)/mypy -p palpate
	$(BIN)/codespell $$(git ls-files)
	$(BIN)/python .ci/actionlint

docs: $(VENV)/documented-with
	rm -rf docs/reference/generated
	$(BIN)/python -m sphinx --quiet --fail-on-warning --keep-going docs build/docs
	@echo "the site: build/docs/index.html"

docs-figures:
	$(PYTHON) docs/figures.py

bench: $(VENV)/benched-with
	$(BIN)/python -m benchmarks $(PARTS)

wheel: dist/built

# Says what a bare Debian lacks, all of it at once, before anything is downloaded.
tools:
	@PYTHON=$(PYTHON) sh .ci/tools

dist/built: $(SOURCES) | tools $(VENV)/made
	rm -rf dist && mkdir dist
	@echo "compiling about 110 files: two minutes on two cores (all that is said: dist/build.log)"
	@$(BIN)/pip wheel --verbose --no-deps --wheel-dir dist . 2>&1 | tee dist/build.log | \
		grep --line-buffered -oE '\[[0-9]+/[0-9]+\] .*' || true
	@ls dist/*.whl >/dev/null 2>&1 || { tail -n 60 dist/build.log; exit 1; }
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

$(VENV)/notebook-tested-with: $(VENV)/tested-with
	$(BIN)/pip install --quiet "$$(ls dist/*.whl)[jupyterlab]"
	touch $@

$(VENV)/napari-tested-with: $(VENV)/tested-with
	$(BIN)/pip install --quiet "$$(ls dist/*.whl)[napari]"
	touch $@

$(VENV)/torch-tested-with: $(VENV)/tested-with
	$(BIN)/pip install --quiet "$$(ls dist/*.whl)[deepinverse]"
	touch $@

$(VENV)/linted-with: $(VENV)/installed
	$(BIN)/pip install --quiet "$$(ls dist/*.whl)[lint]"
	touch $@

$(VENV)/crossed-with: $(VENV)/installed
	$(BIN)/pip install --quiet "$$(ls dist/*.whl)[cross]"
	touch $@

$(VENV)/benched-with: $(VENV)/installed
	$(BIN)/pip install --quiet "$$(ls dist/*.whl)[bench]"
	touch $@

$(VENV)/documented-with: $(VENV)/installed
	$(BIN)/pip install --quiet "$$(ls dist/*.whl)[docs]"
	touch $@

clean:
	rm -rf $(VENV) dist build demo docs/reference/generated .mypy_cache .ruff_cache .pytest_cache .hypothesis
