# make setup | scenario | test, each from a bare clone.
PYTHON ?= python3.11
NO_PYTHON := arm_brachy set-up: missing $(PYTHON): \
    sudo apt install python3.11 python3.11-venv python3.11-dev (Ubuntu: from ppa:deadsnakes/ppa)
SCENARIO ?= config/scenarios/procedure.yaml

# Another ROS installation or virtual environment that is active must not leak into this one.
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE LD_LIBRARY_PATH AMENT_PREFIX_PATH CMAKE_PREFIX_PATH
unexport PYTHONPATH PYTHONHOME VIRTUAL_ENV
# Without byte code every process compiles all it imports: 5 s of each node, of each command.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help setup scenario test validate docs clean

help:
	@echo 'make setup      .venv with ROS 2 Jazzy, the messages and arm-brachy in it (idempotent)'
	@echo 'make scenario   set-up, then the whole procedure, its recording and its report'
	@echo 'make test       set-up, then lint and tests'
	@echo 'make validate   set-up, then the tests that make test leaves out: whole diagnoses, graphs and builds'
	@echo 'make docs       set-up, then the documentation as a site: site/index.html'
	@echo 'make clean      remove .venv and site; runs/ stays'

setup:
	@$(PYTHON) -c '' 2>/dev/null || { echo '$(NO_PYTHON)' >&2; exit 2; }
	@$(PYTHON) launch_scripts/bootstrap.py
	@$(if $(filter setup,$(MAKECMDGOALS)),echo 'Set up. In every shell: source .venv/bin/activate      then: arm-brachy --help',:)

scenario: setup
	.venv/bin/arm-brachy run $(SCENARIO)

test: setup
	.venv/bin/ruff check .
	.venv/bin/python -m pytest -n 2 --dist worksteal --ignore test/ros -m 'not validate'
	.venv/bin/python -m pytest -n 3 --dist loadfile test/ros -m 'not wall and not validate'
	.venv/bin/python -m pytest test/ros -m 'wall and not validate'

validate: setup
	.venv/bin/python -m pytest -n 2 --dist load --ignore test/ros -m validate
	.venv/bin/python -m pytest -n 2 --dist loadfile test/ros -m 'validate and not wall'
	.venv/bin/python -m pytest test/ros -m 'validate and wall'

docs: setup
	NO_MKDOCS_2_WARNING=1 .venv/bin/mkdocs build --strict
	@echo 'site/index.html      with search: python -m http.server -d site, then http://localhost:8000'

clean:
	rm -rf .venv site
