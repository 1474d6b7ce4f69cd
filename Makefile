.DEFAULT_GOAL := help
PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
READY := $(VENV)/.ready
PYTEST := $(BIN)/python -m pytest -n logical --maxprocesses 8 --dist worksteal

# Where it is set, every process of every run would read all sources anew.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: help setup demo test test-fast lint coverage studies mutants bench wheel sbom release-notes clean

help:
	@echo "make demo     install what is missing and run a simulated line: trigger, measurement, record, answer"
	@echo "make test     run the tests, two more at a time than there are cores"
	@echo "make test-fast  those that take less than five seconds each"
	@echo "make lint     format, style, types, import layers"
	@echo "make coverage whether every branch of verdict and handshake is run by its own tests"
	@echo "make studies  the long accuracy studies, and docs/accuracy.md from them"
	@echo "make mutants  mutation testing of the verdict, of straight ahead and ride height, and of the line's handshake"
	@echo "make bench    the program against its peers, in one run"
	@echo "make wheel    the wheel of the last commit, the same bits wherever it is built"
	@echo "make sbom     its bill of materials, CycloneDX; PACKAGES=FOLDER adds the hashes of downloaded packages"
	@echo "make release-notes  what CHANGELOG.md says of VERSION=, Unreleased if none is named"
	@echo "make setup    only install, into .venv"
	@echo "make clean    remove .venv"

setup: $(READY)

$(INSTALLED): requirements.lock pyproject.toml tools/setup
	PYTHON=$(PYTHON) tools/setup $(VENV)
	@touch $@

# Status 1: compiled, but it could not be kept; it said so, and everything works.
$(READY): $(INSTALLED)
	$(BIN)/truewheel warm-up || [ $$? -eq 1 ]
	@touch $@

demo: setup
	$(BIN)/truewheel demo

test: setup
	$(PYTEST)

test-fast: setup
	$(PYTEST) -m "not slow"

# Needs nothing compiled, so that both can be done at once.
lint: $(INSTALLED)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

coverage: setup
	$(BIN)/python tools/branches.py

studies: setup
	@$(BIN)/truewheel study all --out out/studies; status=$$?; \
		$(BIN)/python tools/accuracy.py out/studies && exit $$status

mutants: setup
	$(BIN)/python tools/mutate.py

bench: setup
	@$(BIN)/python -m benchmarks.measure_wheel; status=$$?; \
		$(BIN)/python -m benchmarks.calibration && $(BIN)/python -m benchmarks.cameras && exit $$status

# Needs nothing compiled.
wheel: $(INSTALLED)
	$(BIN)/python -m tools.wheel

sbom: wheel
	$(BIN)/python -m tools.sbom $(if $(PACKAGES),--packages "$(PACKAGES)")

release-notes: $(INSTALLED)
	@$(BIN)/python -m tools.release_notes $(or $(VERSION),Unreleased)

clean:
	rm -rf $(VENV)
