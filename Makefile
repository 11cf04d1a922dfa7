# Every target sets up what it needs, from a bare python3 with venv and pip.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check
EXTRAS := xarray,hub,store,cluster,perception,viewer,rig,realsense,calibrate
comma := ,
TESTS ?=
COUNT ?= 100000
SEED ?= 0
WORKERS ?= 2

.PHONY: help setup setup-train hooks demo test coverage fuzz faults mutants sbom lock lint format-check style types layers docs bench clean

help:
	@echo "make setup        everything but torch, into $(VENV)"
	@echo "make setup-train  setup, and torch"
	@echo "make hooks        setup, and lint before every commit (pre-commit)"
	@echo "make demo         the main job: image three objects, and scissors in a carton, into demo/index.html"
	@echo "make test         all tests and doctests (TESTS=path or -k name for some, WORKERS=2 processes)"
	@echo "make coverage     make test, and how much of the code it ran: build/coverage/index.html"
	@echo "make fuzz         100 000 damaged files against every reader (COUNT=, SEED=)"
	@echo "make faults       every command that writes, broken off at every step: killed, disk full, no rights, two at once"
	@echo "make mutants      physics broken on purpose: every time a test must fail"
	@echo "make sbom         all components and their licences, in CycloneDX: build/sbom.json"
	@echo "make lock         every version that a release may be installed with, and its hashes: build/requirements.lock"
	@echo "make lint         formatting, style, types, layers"
	@echo "make docs         the documentation, into build/docs/html; runs the tutorials' notebooks and checks every link"
	@echo "make bench        the benchmarks and their tables"

setup: $(VENV)/setup.stamp

$(VENV)/setup.stamp: pyproject.toml constraints.txt
	@echo "installing into $(VENV), some minutes"
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(PIP) install --quiet --upgrade "pip>=25.1"
	$(PIP) install --quiet --no-compile --constraint constraints.txt --group dev --editable ".[$(EXTRAS)]"
	touch $@

setup-train: $(VENV)/train.stamp

$(VENV)/train.stamp: $(VENV)/setup.stamp
	@echo "installing torch into $(VENV), some minutes"
	$(PIP) install --quiet --no-compile --constraint constraints.txt --editable ".[$(EXTRAS),train]"
	touch $@

hooks: setup
	$(BIN)/pre-commit install

demo: setup
	$(BIN)/millisight demo --output demo

# Threads that wait give way: several processes share the cores, and waiting busily would cost them more than half.
# OpenBLAS uses one thread: beside another process, a second one makes fits of small matrices take half as long again.
SHARED := OMP_WAIT_POLICY=passive OPENBLAS_NUM_THREADS=1
TEST := $(SHARED) $(BIN)/python -m pytest

test: setup
	$(TEST) -n $(WORKERS) --dist worksteal $(TESTS)

# Reported, and no bar: kernels that Numba compiles are not seen to run.
coverage: setup
	$(TEST) -n $(WORKERS) --dist worksteal --cov --cov-report=term:skip-covered --cov-report=html $(TESTS)

fuzz: setup
	$(BIN)/python tests/fuzz/parsers.py --count $(COUNT) --seed $(SEED)

faults: setup
	$(BIN)/python tests/faults.py

# Physics broken on purpose, a place at a time: the nearest tests must fail.
mutants: setup
	$(BIN)/python tests/mutations.py

# In an environment of its own: what lists the components is none of them.
sbom: setup
	$(PYTHON) -m venv build/sbom
	build/sbom/bin/python -m pip install --quiet --disable-pip-version-check cyclonedx-bom
	build/sbom/bin/cyclonedx-py environment $(BIN)/python --pyproject pyproject.toml --output-reproducible -o build/sbom.json

# For every system and every Python that is promised; where the packages came from is not told. Without the extra `cuda`,
# which asks for another CUDA than torch does.
lock:
	$(PYTHON) -m venv build/lock
	build/lock/bin/python -m pip install --quiet --disable-pip-version-check uv
	build/lock/bin/uv pip compile --quiet --universal --generate-hashes --constraint constraints.txt --no-header \
		--no-annotate --no-emit-index-url $(patsubst %,--extra %,$(subst $(comma), ,$(EXTRAS)) train tensorboard) \
		-o build/requirements.lock pyproject.toml

lint: format-check style types layers

format-check: setup
	$(BIN)/ruff format --check .

style: setup
	$(BIN)/ruff check .

# torch's classes are among the types. ty checks all, pyright what is to be strict, and that every public name has a type.
types: setup-train
	$(BIN)/ty check --python $(BIN)/python
	$(BIN)/pyright --pythonpath $(BIN)/python
	PATH="$(abspath $(BIN)):$$PATH" pyright --verifytypes millisight --ignoreexternal

layers: setup
	$(BIN)/lint-imports

docs: setup
	$(SHARED) $(BIN)/python -m sphinx --jobs $(WORKERS) --quiet --fresh-env --fail-on-warning --keep-going -d build/docs/doctrees docs build/docs/html

bench: setup
	$(BIN)/python -m pytest $(if $(findstring benchmarks/,$(TESTS)),,benchmarks) --benchmark-disable-gc --benchmark-columns=median,iqr,rounds -q -s $(TESTS)

clean:
	rm -rf $(VENV) dist build demo .pytest_cache .ruff_cache .hypothesis
