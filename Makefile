# make demo | test | check | install | pictures; everything installs itself into .venv
PYTHON ?= python3
BIN := .venv/bin
OUT ?=
SEED ?= 1

.PHONY: demo test check lint types install install-dev pictures clean

demo: install
	$(BIN)/pace run ikea_chair --level plant --seed $(SEED) $(if $(OUT),--out $(OUT))

test: install-dev
	$(BIN)/python -m pytest

check: install-dev lint types test

lint: install-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: install-dev
	$(BIN)/mypy

install: .venv/installed

install-dev: .venv/installed-dev

.venv/installed: pyproject.toml
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e .
	touch $@

# torch is named with its range first, so that pip takes a CPU build and not the newest CUDA one.
.venv/installed-dev: pyproject.toml .venv/installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[train,lcm,tune,data,ray,diagram,perception,dev]"
	touch $@

clean:
	rm -rf .venv dist build

pictures: install
	$(BIN)/python docs/pictures.py
