# Everything a fresh machine with Python 3.11 and make needs.

# A test keeps about one core busy, but some wait; two cores have work for three.
# A test's process starts in half the time where bytecode is kept.
TESTS_AT_ONCE ?= 3
# Two threads of NumPy that share a core wait for each other, at the cost of both.
ONE_THREAD := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
BIN := $(VENV)/bin
NAME ?= nao-pong
ACTORS ?= 1
ARGS ?=
RESULTS := benchmarks/results
NVIDIA_DEVICE ?= /dev/nvidiactl
# PyPI's PyTorch is the CUDA build. Where there is no GPU and nobody has chosen an index, pip gets PyTorch's index of
# CPU builds too: 2.13.0+cpu meets ==2.13.0, and wins as the higher version (PEP 440). `pip config list` has PIP_* too.
CPU_TORCH := https://download.pytorch.org/whl/cpu
WANTS_CPU_TORCH = test -z "$$CI" -a ! -e $(NVIDIA_DEVICE) && ! command -v nvidia-smi >/dev/null && \
	! $(BIN)/python -m pip config list | grep -E '^[^=]*(index|url|find-links)[^=]*=' >/dev/null

.PHONY: browser help setup train test suite test-extras test-slow test-native test-lowest check bench figures screens docs wheel lock clean

help:  ## this list
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*##/ —/'

setup: $(VENV)/.installed  ## make .venv from requirements.lock (nothing to do when it is up to date)

$(VENV)/.installed: requirements.lock requirements-torch.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 13))' || \
		{ echo "error: Python 3.11 or 3.12 is needed: install it, or name it by PYTHON=PATH." >&2; exit 2; }
	@echo "making $(VENV) with $(PYTHON)"
	@$(PYTHON) -m venv $(VENV)
	@echo "fetching and installing the $$(grep -c == requirements.lock) packages of requirements.lock: minutes"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --require-hashes -r requirements.lock
	@if $(WANTS_CPU_TORCH); then index="--extra-index-url $(CPU_TORCH)"; \
		echo "fetching and installing PyTorch for CPU, since no NVIDIA GPU was found: minutes;" \
			"for CUDA: PIP_INDEX_URL=https://pypi.org/simple make setup"; \
	else index=; \
		echo "fetching and installing PyTorch (requirements-torch.lock): minutes, gigabytes if it is the CUDA build"; fi; \
	$(BIN)/python -m pip install --quiet --disable-pip-version-check $$index -r requirements-torch.lock
	@echo "installing ALE-Robot from this folder"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@$(BIN)/python -c 'import torch; print(f"done, with PyTorch {torch.__version__}: next, . $(BIN)/activate && ale-robot watch")'
	@touch $@

# How the run says at its end that it goes on, if it is one that `make train` finds again below.
GIVEN = $(foreach name,NAME ACTORS ARGS,$(if $(filter-out file,$(origin $(name))),$(name)='$(subst ','\'',$(value $(name)))'))
train: export ALE_ROBOT_AGAIN = $(if $(filter --run% --connect%,$(ARGS)),,$(strip make train $(GIVEN)))
train: setup  ## train the robot on this machine until Ctrl-C; go on by running it again (NAME=, ACTORS=, ARGS=)
	$(BIN)/ale-robot train --run $(NAME) --actors $(ACTORS) \
		$(if $(wildcard runs/$(NAME)/replay),--resume) $(ARGS)

test: setup  ## static checks, and beside them the whole test suite
	@$(MAKE) --no-print-directory -j2 check suite

suite: setup
	PYTHONDONTWRITEBYTECODE= $(ONE_THREAD) $(BIN)/python -m pytest -m "not slow" -n $(TESTS_AT_ONCE) --dist worksteal

browser:  ## install Chromium by apt, in which a test opens the page of a run; without it that test is skipped
	apt-get install --yes --no-install-recommends chromium

EXTRAS := graphics,hub,mlflow,ops,plot,record,sweep,trackio,viz,wandb,web

test-extras: setup  ## install the optional extras, all but Ray, and run the tests that they have, which are skipped without them
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[dev,$(EXTRAS)]"
	$(BIN)/python -m pytest -m "not slow" -rs tests/ale_robot tests/benchmarks/lab tests/learner/telemetry tests/viewer

test-slow: setup  ## the tests that take minutes each
	$(BIN)/python -m pytest -m slow

SANITIZERS = $(foreach name,asan ubsan,$(shell g++ -print-file-name=lib$(name).so))

test-native: setup  ## the tests of the native kernel, compiled by g++ so that each wrong access to memory ends it
	@# A cache of its own, so that nobody else loads these libraries, which are many times as slow.
	cache=$$(mktemp -d) && trap 'rm -rf "$$cache"' EXIT && XDG_CACHE_HOME=$$cache \
	CXX="g++ -fsanitize=address,undefined -fno-sanitize-recover=all" \
	LD_PRELOAD="$(SANITIZERS)" ASAN_OPTIONS=detect_leaks=0 \
	$(BIN)/python -m pytest tests/common/native/test_network.py tests/learner/algorithm/test_optimizers.py \
	tests/learner/algorithm/test_qr_dqn.py -k "not memory"

OLDEST_TORCH = $(shell sed -n 's/^ *"\(torch\)>=\(.*\)",/\1==\2/p' pyproject.toml)

test-lowest: setup  ## the test suite with the oldest versions that pyproject.toml allows, in .venv-lowest
	$(PYTHON) -m venv --clear $(VENV)-lowest
	@# uv, which knows nothing of pip's indexes, keeps the build of PyTorch that pip has found.
	$(VENV)-lowest/bin/python -m pip install --quiet --disable-pip-version-check \
		$$($(WANTS_CPU_TORCH) && echo --extra-index-url $(CPU_TORCH)) $(OLDEST_TORCH)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check uv
	$(BIN)/uv pip install --quiet --python $(VENV)-lowest/bin/python --resolution lowest-direct \
		--editable ".[dev]"
	@rm -rf *.egg-info  # it would stand for the installed metadata
	@$(MAKE) --no-print-directory suite BIN=$(VENV)-lowest/bin

bench: setup  ## measure all speeds on this machine, 70 minutes; the tables of benchmarks/RESULTS.md
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[bench]"
	$(BIN)/python -m benchmarks all
	$(BIN)/python -m benchmarks.figures.results_page
	$(MAKE) figures

PLOT := $(BIN)/python -m benchmarks.figures.plot
LADDER := $(RESULTS)/ladder-
R1 := $(addprefix $(LADDER)R1-pong-fast-seed-,1.csv 2.csv 3.csv)

figures: setup  ## draw the figures of docs/ from the results
	$(PLOT) --figure progress --phase train -o docs/robot_learns.png \
		$(addprefix $(LADDER)R5-,$(addprefix pong-robot-seed-,1.csv 2.csv) \
		$(addprefix vector-pong-robot-seed-,1.csv 2.csv) vector-lr-1e-4-pong-robot-seed-1.csv) \
		--names "robot, camera frames alone" "with proprioception" \
		"with proprioception, lower learning rate"
	$(PLOT) --figure progress --phase train -o docs/ale_learns.png \
		$(R1) $(RESULTS)/ale_fast_30min.csv --names "former preset fast" "first preset fast"
	$(PLOT) --figure progress --phase train -o docs/rungs_learn.png \
		$(R1) $(patsubst %,$(LADDER)%-vector-pong-robot-seed-1.csv,R2 R3 R4) \
		--names "R1, emulator alone" "R2, latency of hands" "R3, camera without hands" \
		"R4, hands without camera"
	$(PLOT) --figure progress --phase train -o docs/breakout_learns.png \
		$(LADDER)R5-vector-breakout-robot-seed-1.csv --names "robot with proprioception, Breakout"
	$(PLOT) --figure histogram -o docs/scores.png $(LADDER)R1-pong-fast-seed-1.json \
		$(LADDER)R5-pong-robot-seed-1.json $(LADDER)R5-vector-pong-robot-seed-1.json \
		$(RESULTS)/robot_pong_async.json --names "emulator alone (R1, seed 1)" \
		"robot, camera frames alone (R5, seed 1)" "robot with proprioception (R5, seed 1)" \
		"published robot policy in real time"
	$(PLOT) --figure latency $(RESULTS)/hand_latency.csv -o docs/hand_latency.png \
		--names "trained without latency (ale_pong)" "trained with 33 ms of latency (R2)"
	$(PLOT) --figure press $(RESULTS)/press_latency.json -o docs/press_latency.png
	$(PLOT) --figure race $(addprefix $(RESULTS)/race_,ale_450k.json ale_peer.json robot_400k.json robot_before.json) \
		-o docs/race.png --names "emulator alone, preset fast" "stable-baselines3, emulator alone" \
		"robot, preset robot" "robot, the preset before"
	$(PLOT) --figure robustness $(patsubst %,$(RESULTS)/robustness_robot_pong_%.json,sticky worlds robust_sticky) -o docs/robustness.png
	$(PLOT) --figure robustness $(wildcard $(RESULTS)/latency_*.json) -o docs/latency.png
	$(PLOT) --figure games $(RESULTS)/games.json -o docs/games.png
	$(PLOT) --figure scaling $(RESULTS)/scaling.json -o docs/scaling.png

screens: setup  ## draw docs/screen.png and docs/web.png from a run of some minutes; it needs `make browser`
	$(BIN)/python -m benchmarks.figures.screens

docs: setup  ## build the documentation's site in build/site, and check its links
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[docs]"
	$(BIN)/python -m docs.settings
	$(BIN)/python -m docs.metrics
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet && echo "wrote build/site/index.html"

wheel: setup  ## build the wheel that pip installs anywhere, in dist/
	rm -rf build
	$(BIN)/python -m pip wheel --quiet --disable-pip-version-check --no-deps --no-build-isolation -w dist .
	rm -rf *.egg-info  # it would stand for the installed metadata

check: setup  ## ruff and mypy
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

lock: setup  ## write the versions installed now into requirements.lock, with their hashes on PyPI, and requirements-torch.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check uv
	$(BIN)/python -m pip list --format=freeze --exclude-editable --exclude pip --exclude uv --exclude torch \
		> $(VENV)/versions.txt
	(echo "# Exact versions that make setup installs, all but torch. Regenerate with make lock."; \
	 $(BIN)/uv pip compile $(VENV)/versions.txt --no-config --index-url https://pypi.org/simple --no-deps \
		--generate-hashes --no-header --no-annotate --quiet) > $(VENV)/hashed.txt
	mv $(VENV)/hashed.txt requirements.lock
	(echo "# Without a hash: PyPI has the CUDA build and PyTorch's own index one for each kind of machine."; \
	 $(BIN)/python -m pip list --format=freeze | sed -n 's/+.*//; /^torch==/p') > requirements-torch.lock

clean:  ## remove .venv and caches; runs/ stays
	rm -rf $(VENV) $(VENV)-lowest .pytest_cache .mypy_cache .ruff_cache .hypothesis *.egg-info
