# make scan      the letters of the paper: data and pictures into results/
# make test      the tests that take seconds, some of the mechanics on two ranks as well
#                (make fast, make ranks, make site: its three parts)
# make test-all  all tests: also the demos, long scans and kills at random
# make wheel     builds what pip installs into dist, and tries it without the sources
# make coverage  how many of the lines the fast tests reach
# make env       only the environment, in .venv
# make docs      the site: pages, gallery and reference, in build/site
# make tutorials runs the notebooks of the site again and keeps their outputs
# make lint      style
# make clean     removes the environment and caches, never results
#
# Variables: RANKS=2 STUDY=study.toml SET="stimulus.text=EFG protocol.depth_mm=1.5"
# RESULTS=folder PYTHON=python3 (an environment of your own that has DOLFINx)
# BASE_PYTHON=python3.13 (from which .venv is made; default the first that suits).

RANKS   ?= $(shell test "$$(env -u OMP_NUM_THREADS nproc 2>/dev/null || echo 1)" -ge 2 && echo 2 || echo 1)
STUDY   ?=
SET     ?=
RESULTS ?=
PYTEST  := -m pytest -q --numprocesses auto --maxprocesses 4 --dist worksteal
export OMP_NUM_THREADS ?= 1

ifneq ($(origin PYTHON),command line)
PYTHON := .venv/bin/python
ENVIRONMENT := .venv/.complete
DOCS := .venv/.docs
READERS := .venv/.readers
endif

.PHONY: scan test fast ranks site test-all wheel coverage env docs tutorials lint clean help

scan: $(ENVIRONMENT)
	@$(PYTHON) -m tactile_fem.runtime.doctor
	@folder="$(RESULTS)"; n=1; \
	if [ -z "$$folder" ]; then \
	  folder=results/scan; \
	  while [ -n "$$(ls -A "$$folder" 2>/dev/null)" ]; do \
	    n=$$((n + 1)); folder="results/scan-$$n"; \
	  done; \
	fi; \
	$(PYTHON) -m tactile_fem scan $(STUDY) $(SET:%=--set %) --ranks $(RANKS) --results "$$folder"

test: fast ranks site

fast: $(ENVIRONMENT) $(DOCS)
	@$(PYTHON) -m tactile_fem.runtime.doctor
	$(PYTHON) $(PYTEST) -m "not slow and not site"

ranks: $(ENVIRONMENT)
	$(PYTHON) tests/on_two_ranks.py -m "ranks and not slow"

site: $(ENVIRONMENT) $(DOCS)
	$(PYTHON) -m pytest -q -m site tests/test_site.py

test-all: $(ENVIRONMENT) $(DOCS) $(READERS)
	@$(PYTHON) -m tactile_fem.runtime.doctor
	$(PYTHON) $(PYTEST) -m "not site"
	$(PYTHON) tests/on_two_ranks.py
	$(PYTHON) -m pytest -q -m site tests/test_site.py

wheel: $(ENVIRONMENT)
	@rm -rf dist build/lib
	$(PYTHON) -m uv build --quiet --out-dir dist || $(PYTHON) -m pip wheel --quiet --no-deps --wheel-dir dist .
	.ci/try-wheel dist/*.whl

coverage: $(ENVIRONMENT) $(DOCS)
	@.ci/install $(PYTHON) -e ".[coverage]"
	$(PYTHON) $(PYTEST) --cov=tactile_fem --cov-report=term:skip-covered -m "not slow and not site"

env: $(ENVIRONMENT)

.venv/.complete: pyproject.toml .ci/make-env .ci/install
	@.ci/make-env
	@touch $@

.venv/.docs: .venv/.complete
	@echo "Installing what builds the site and runs many scans ..." >&2
	@.ci/install $(PYTHON) -e ".[docs,cluster]"
	@touch $@

.venv/.readers: .venv/.complete
	@.ci/install $(PYTHON) -e ".[neo,nwb,readers]"
	@touch $@

docs: $(DOCS)
	@rm -rf build/site demos/pages/gallery demos/pages/reference/generated
	@$(PYTHON) -m sphinx -W --keep-going -q -E -d build/doctrees demos/pages build/site
	@echo "build/site/index.html"

tutorials: $(DOCS)
	@$(PYTHON) demos/pages/run_tutorials.py

lint: $(ENVIRONMENT)
	$(PYTHON) -m ruff check .
	$(PYTHON) -m ruff format --check .
	$(PYTHON) -m mypy

clean:
	rm -rf .venv build dist *.egg-info .pytest_cache .ruff_cache .mypy_cache
	find tactile_fem tests demos -name __pycache__ -type d -prune -exec rm -rf {} +

help:
	@sed -n '/^$$/q; s/^# \{0,1\}//p' Makefile
