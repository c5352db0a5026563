# Development tasks; `make` lists them. Needs Python 3.10 to 3.13 and pip: PYTHON=... names one.

PYTHON ?=
VENV := .venv
INSTALLED := $(VENV)/.installed
# A part of it, with what demo and console need.
DEMO_INSTALLED := $(VENV)/.installed-demo
BENCH_VENV := .venv-bench
BENCH_INSTALLED := $(BENCH_VENV)/.installed

# What `make lock` pins: the extras of setup.py that demo and console need, and all that `make setup`
# installs.
DEMO_EXTRAS := ros console evaluation recordings
LOCKED_EXTRAS := $(DEMO_EXTRAS) parquet ray tune test docs development

# Not the whole folder: what `track` and others have written into it is no text of this project.
SPELLED := $(addprefix ./,$(wildcard *.md *.py *.rst *.toml *.cfg *.xml Makefile benchmarks config demo docs \
	examples launch pf_tracker_ros requirements test tools))

# What `make bench` runs on, and further arguments for it.
SEQUENCES ?=
BENCH_ARGS ?=

# What `make figures` runs on: see benchmarks/figures.py.
FOOTAGE ?=

PYTEST := $(VENV)/bin/python -m pytest --numprocesses 2 --dist loadfile

# Further arguments for `make console`.
CONSOLE_ARGS ?=

# Nothing that the tests and the demo publish leaves the machine.
export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST

# The environment brings its own ROS; one sourced from elsewhere would mix with it.
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE
ifdef AMENT_PREFIX_PATH
unexport AMENT_PREFIX_PATH LD_LIBRARY_PATH PYTHONPATH RMW_IMPLEMENTATION
endif

# The built documentation.
DOCS := build/docs

.PHONY: help setup test test-all lint demo console docs bench figures sequences-given generate lock clean

help:  ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-10s%s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup: $(INSTALLED)  ## create .venv with everything pinned, and this package in it

$(INSTALLED): requirements/development.txt requirements/environment.sh setup.py pyproject.toml
	@requirements/environment.sh $(VENV) requirements/development.txt $(PYTHON)
	@touch $@ $(DEMO_INSTALLED)

$(DEMO_INSTALLED): requirements/demo.txt requirements/environment.sh setup.py pyproject.toml
	@requirements/environment.sh $(VENV) requirements/demo.txt $(PYTHON)
	@touch $@

$(BENCH_INSTALLED): requirements/bench.txt requirements/development.txt \
		requirements/environment.sh setup.py
	@requirements/environment.sh $(BENCH_VENV) requirements/bench.txt $(PYTHON)
	@touch $@

test: lint  ## lint, types and the quick tests (PYTEST_ARGS=... narrows them down)
	$(PYTEST) -m "not slow" $(PYTEST_ARGS)

test-all: lint  ## lint, types and all tests, with the slow ones
	$(PYTEST) $(PYTEST_ARGS)

lint: $(INSTALLED)  ## lint, format, spelling and types alone
	$(VENV)/bin/ruff check
	$(VENV)/bin/ruff format --check
	$(VENV)/bin/codespell $(SPELLED)
	$(VENV)/bin/mypy

demo: $(DEMO_INSTALLED)  ## a page with tracked videos and reports, demo/index.html; first video after a minute
	$(VENV)/bin/python demo/run.py

console: $(DEMO_INSTALLED)  ## the tracker's web page with a tour on drawn clips (CONSOLE_ARGS="--port 8700")
	$(VENV)/bin/python demo/console.py $(CONSOLE_ARGS)

docs: $(INSTALLED)  ## build the documentation; open build/docs/index.html
	$(VENV)/bin/python -m sphinx -W --keep-going --quiet -b html docs $(DOCS)
	@echo "the documentation: $(DOCS)/index.html"

bench: sequences-given $(BENCH_INSTALLED)  ## all presets and other trackers on SEQUENCES="..." (in .venv-bench)
	$(BENCH_VENV)/bin/python benchmarks/peers.py $(SEQUENCES) $(BENCH_ARGS)

figures: $(BENCH_INSTALLED)  ## measure all figures of README and docs on FOOTAGE=FOLDER, hours
	$(BENCH_VENV)/bin/python benchmarks/figures.py measure $(FOOTAGE)
	$(BENCH_VENV)/bin/python benchmarks/figures.py write

sequences-given:
	@test -n "$(strip $(SEQUENCES))" || { \
		echo 'error: no sequences; name their folders (groundtruth.txt and img/):' \
			'make bench SEQUENCES="FOLDER ..."' >&2; exit 1; }

generate: $(INSTALLED)  ## write config/*.yaml and docs/parameters.md from the declared parameters
	$(VENV)/bin/python tools/generate.py

lock: $(INSTALLED)  ## pin the newest versions that setup.py allows
	$(VENV)/bin/uv pip compile --quiet --universal --python-version 3.10 --no-python-downloads \
		$(LOCKED_EXTRAS:%=--extra %) --no-annotate --custom-compile-command 'make lock' \
		setup.py > $(VENV)/lock.txt
	mv $(VENV)/lock.txt requirements/development.txt
	$(VENV)/bin/uv pip compile --quiet --universal --python-version 3.10 --no-python-downloads \
		$(DEMO_EXTRAS:%=--extra %) --no-annotate --custom-compile-command 'make lock' \
		--constraint requirements/development.txt setup.py > $(VENV)/lock.txt
	mv $(VENV)/lock.txt requirements/demo.txt

clean:  ## remove .venv, .venv-bench and everything built
	rm -rf $(VENV) $(BENCH_VENV) build install log dist *.egg-info demo/*/ demo/index.html
	rm -rf .pytest_cache .mypy_cache .ruff_cache .hypothesis .coverage
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
