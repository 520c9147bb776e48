# Every target sets up what it needs, on a machine with Python >= 3.11 and make.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --quiet --disable-pip-version-check
LOCK_VENV := build/lock
RUN_ARGS ?=
# A command that takes `build` and `compose` as docker does.
export CONTAINER_ENGINE ?= docker
# The engine's own command, for what compose has no word for: `network disconnect`, `pause`.
export CONTAINER_CLI ?= docker
IMAGES := router replay bridge robot actor learner
# Built on by the digest that the engine has of it, or on another image by its own digest.
PYTHON_IMAGE ?= docker.io/library/python:3.11-slim-bookworm

.PHONY: help run test test-slow test-faults soak test-containers check docs format lock images clean bench-messages bench-effects bench-joint-control bench-bridge bench-kills bench-fit bench-tracking bench-diagnosis tables

help:  ## say what can be made
	@sed -En 's/^([a-z-]+):.*## (.*)/\1\t\2/p' $(MAKEFILE_LIST) | expand -t 18

# Nothing floats: the lock names every package, those that build this one included. Compiled once:
# where Python may not write byte code, every process of a service would compile it anew.
$(VENV)/.installed: pyproject.toml requirements.lock
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(PIP) install --requirement requirements.lock
	$(PIP) install --no-deps --no-build-isolation --editable .
	$(BIN)/python -m compileall -q src proto services
	touch $@

run: $(VENV)/.installed  ## close the loop once on this machine (RUN_ARGS=--help)
	$(BIN)/gfm run $(RUN_ARGS)

test: $(VENV)/.installed  ## run the tests
	$(BIN)/python -m pytest -m "not slow and not containers" --numprocesses 2 --dist loadgroup

test-slow: $(VENV)/.installed  ## run the tests that take longer
	$(BIN)/python -m pytest -m "slow and not containers"

test-containers: $(VENV)/.installed images  ## run the system in containers
	$(BIN)/python -m pytest -m containers

check: $(VENV)/.installed docs  ## check format, lint, imports, types and links of the documentation
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/lint-imports
	$(BIN)/mypy

docs: $(VENV)/.installed  ## build the documentation as a site, build/site; fails on a broken link
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict

test-faults: $(VENV)/.installed  ## hurt a system of processes 160 times (15 minutes; again goes on)
	$(BIN)/python benchmarks/faults.py --folder build/faults --kills 100 --others 60

soak: $(VENV)/.installed  ## let a system of processes work for an hour: its memory stays flat
	rm -rf build/soak
	$(BIN)/python benchmarks/soak.py --folder build/soak --minutes 60

bench-messages: $(VENV)/.installed  ## give every command bad input; writes docs/messages.md (two minutes)
	$(BIN)/python benchmarks/messages.py

bench-effects: $(VENV)/.installed  ## see whether runs name what their robots hide (20 runs)
	$(BIN)/python benchmarks/effects_10_seeds.py

bench-joint-control: $(VENV)/.installed build/peers  ## compare all models of the arm, 3 effects x 3 seeds (an hour)
	PYTHONPATH=build/peers $(BIN)/python benchmarks/joint_control.py

bench-bridge: $(VENV)/.installed  ## attack the robot bridge, and stop it in every way (hours; goes on where it ended)
	$(BIN)/python benchmarks/bridge_safety.py --commands 1000000 --tries 100 --parts build/bridge_parts

bench-kills: $(VENV)/.installed  ## kill a process that records, 10,000 times (4 hours; goes on where it ended)
	$(BIN)/python benchmarks/recording_kills.py --kills 10000 --parts build/kill_parts

bench-fit: $(VENV)/.installed build/peers  ## fit generalized forces warm and from nothing (half an hour)
	PYTHONPATH=build/peers $(BIN)/python benchmarks/fit_forces.py

# Peers need packages that nothing else here does: they stay out of the lock and the environment.
build/peers: benchmarks/peers/requirements.txt $(VENV)/.installed
	$(PIP) install --target $@ --no-deps --upgrade --requirement $<
	touch $@

bench-tracking: $(VENV)/.installed  ## track the object through faults, and in drawn images (10 minutes)
	$(BIN)/python benchmarks/tracking.py --out docs/results/tracking.md

tables: $(VENV)/.installed  ## close the loop on a task, 10 campaigns x 3 seeds (hours; again goes on)
	$(BIN)/python benchmarks/campaigns.py --parts build/campaigns

bench-diagnosis: $(VENV)/.installed build/peers  ## judge the diagnosis where the truth is known (hours)
	$(BIN)/python benchmarks/diagnosis.py --peers

format: $(VENV)/.installed  ## format and repair what can be repaired
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

# Keeps the versions that are there: delete the lines that should move, or the file for all.
# torch's own CUDA packages are left out: it names them to the digit, and its CPU build has none.
lock:  ## write requirements.lock and requirements.hashes from pyproject.toml
	touch requirements.lock
	$(PYTHON) -m venv --clear $(LOCK_VENV)
	$(LOCK_VENV)/bin/python -m pip --quiet uninstall --yes setuptools
	$(LOCK_VENV)/bin/python -m pip --quiet install --constraint requirements.lock '.[dev]'
	{ echo '# Written by `make lock` from pyproject.toml.'; \
	  $(LOCK_VENV)/bin/python -m pip freeze --all --exclude pip --exclude gfm-sim2real \
	  | sed -E '/^(cuda|nvidia|triton)/d; s/\+[a-z0-9.]+$$//'; } > $(LOCK_VENV)/requirements.lock
	mv $(LOCK_VENV)/requirements.lock requirements.lock
	$(LOCK_VENV)/bin/python -m pip --quiet install uv
	{ echo '# Written by `make lock`: the versions of requirements.lock, with the hashes of their files.'; \
	  $(LOCK_VENV)/bin/uv pip compile --quiet --no-deps --no-header --no-annotate --generate-hashes \
	  requirements.lock; } > $(LOCK_VENV)/requirements.hashes
	mv $(LOCK_VENV)/requirements.hashes requirements.hashes
	rm -r $(LOCK_VENV)

images:  ## build the container images, with CONTAINER_ENGINE (docker)
	base=$$(docker/base-image $(CONTAINER_CLI) $(PYTHON_IMAGE)) && \
	for image in $(IMAGES); do \
	  $(CONTAINER_ENGINE) build . --file docker/Dockerfile --target $$image --tag gfm-$$image \
	    --build-arg PYTHON_IMAGE=$$base --label org.opencontainers.image.base.name=$$base || exit; \
	done

clean:  ## remove what was made, except runs
	rm -rf $(VENV) build dist .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis
