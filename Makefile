# make demo | test | check | install | peers | pictures; everything installs itself into .venv, peers into their own
PYTHON ?= python3
BIN := .venv/bin
OUT ?=
SEED ?= 1

.PHONY: demo test check lint types install install-dev peers pictures clean

demo: install
	$(BIN)/pace run ikea_chair --level plant --seed $(SEED) $(if $(OUT),--out $(OUT))

# Where a peer cannot be installed, the tests that need it skip.
test: install-dev
	-@$(MAKE) --no-print-directory --keep-going peers
	$(BIN)/python -m pytest -m "not alone" --numprocesses 2 --dist loadfile
	$(BIN)/python -m pytest -m alone

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
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[train,lcm,tune,data,ray,diagram,perception,driver,dev]"
	touch $@

# Simulated robots by others, for the driver's tests. Their pins clash with each other's and with ours.
peers: .venv-franky/installed .venv-franka/installed

.venv-franky/installed:
	test -x .venv-franky/bin/python || $(PYTHON) -m venv .venv-franky
	.venv-franky/bin/python -m pip install --quiet --disable-pip-version-check franky-sim==1.0.4
	touch $@

# Without trimesh and robot_descriptions, which it needs only where it downloads or converts models.
.venv-franka/installed:
	test -x .venv-franka/bin/python || $(PYTHON) -m venv .venv-franka
	.venv-franka/bin/python -m pip install --quiet --disable-pip-version-check "mujoco>=3.2,<3.3" numpy==1.26.4
	.venv-franka/bin/python -m pip install --quiet --disable-pip-version-check --no-deps franka-sim==1.1.7
	touch $@

clean:
	rm -rf .venv .venv-franky .venv-franka dist build

pictures: install
	$(BIN)/python docs/pictures.py
