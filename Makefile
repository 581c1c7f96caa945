# Runs in a virtual environment of its own; presumes python3 with venv and nothing else.
PYTHON ?= python3
VENV ?= .venv
WORKERS ?= auto

.PHONY: demo docs check test test-slow test-all faults wheel package-check clean

# write a replay to out/
demo: $(VENV)/installed
	$(VENV)/bin/mbvi demo

# build the site of docs/ in out/site; it is read in a browser, without a server
docs: $(VENV)/installed-docs
	NO_MKDOCS_2_WARNING=1 $(VENV)/bin/python -m mkdocs build --quiet
	@echo "open out/site/index.html"

# the fast tests, on all cores
test: $(VENV)/installed-test
	$(VENV)/bin/python -m pytest --numprocesses $(WORKERS) --dist worksteal

# the tests that take more than a few seconds each
test-slow: $(VENV)/installed-test
	$(VENV)/bin/python -m pytest --numprocesses $(WORKERS) --dist worksteal -m slow

# both: tests are collected, and kernels loaded, once
test-all: $(VENV)/installed-test
	$(VENV)/bin/python -m pytest --numprocesses $(WORKERS) --dist worksteal -m ""

# ruff and mypy
check: $(VENV)/installed-test
	$(VENV)/bin/ruff check
	$(VENV)/bin/ruff format --check
	$(VENV)/bin/mypy

# fuzz scenes, states, controls, URDFs, arguments, files and studies, kill runs and workers, fill disks, for 13 minutes
faults: $(VENV)/installed-test
	$(VENV)/bin/python benchmarks/faults.py

# the wheel of this Python with machine code of the kernels, in dist/
wheel: $(VENV)/installed-test
	$(VENV)/bin/python tools/wheel.py dist

# build wheel and sdist, and use the wheel in a fresh environment: the demo, pages of the docs, and TESTS if any are given;
# both are kept in the folder DIST
DIST ?=
package-check: $(VENV)/installed-test
	PYTHON=$(VENV)/bin/python DIST=$(DIST) .ci/package-check $(TESTS)

clean:
	rm -rf $(VENV) out

$(VENV)/installed: pyproject.toml | $(VENV)/bin/pip
	$(VENV)/bin/python -m pip install --disable-pip-version-check --editable .
	@touch $@

$(VENV)/installed-test: pyproject.toml | $(VENV)/bin/pip
	$(VENV)/bin/python -m pip install --disable-pip-version-check --editable '.[test]'
	@touch $@ $(VENV)/installed

$(VENV)/installed-docs: pyproject.toml | $(VENV)/bin/pip
	$(VENV)/bin/python -m pip install --disable-pip-version-check --editable '.[docs]'
	@touch $@ $(VENV)/installed

# pip comes last: where it is missing, an earlier attempt failed
$(VENV)/bin/pip:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo "mbvi needs Python 3.11 or newer, but $(PYTHON) is $$($(PYTHON) --version 2>&1);" \
			"name another: make $(MAKECMDGOALS) PYTHON=python3.12" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
