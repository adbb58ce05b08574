# make          set up .venv if needed, run every shipped study on two cores, print where the report is
# make help     the other targets
# PYTHON=...    the Python to build the environment from (3.11 or newer)
PYTHON ?= python3
CORES ?= 2
REPLICATES ?= 200
# Simulated membranes and tubes to recover, and specimens to tell the order of, per kind.
MEMBRANES ?= 100
TUBES ?= 100
STRUCTURES ?= 100
ORDERS ?= 40
POPULATIONS ?= 100
ORDER_CASES := $(foreach f,rubber film voigt_kelvin kv_gm,"$f closed 1" "$f shown 2" "$f shown_discrepancy 2") \
	"voigt_kelvin shown 3" "kv_gm shown 3"

VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
VERSION := import sys; print("%d.%d.%d" % sys.version_info[:3])
REPORT := results/report/index.html
QUICK_REPORT := results/quick/report/index.html
SNAKEMAKE := $(BIN)/snakemake --cores $(CORES)

# One thread per job: parallelism is over jobs.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
export MKL_NUM_THREADS := 1
export NUMBA_NUM_THREADS := 1
export PATH := $(CURDIR)/$(BIN):$(PATH)
# The user's own Python settings must not leak into the environment.
unexport PYTHONPATH PYTHONHOME VIRTUAL_ENV

.DEFAULT_GOAL := all
.PHONY: all setup test quick extended bench lint docs validate data clean help

all: $(READY)  ## run every shipped study, build the report
	@$(SNAKEMAKE) --workflow-profile workflow/profiles/default
	@echo "Report: $(CURDIR)/$(REPORT)"

setup: $(READY)  ## only make the environment

$(READY): requirements.lock pyproject.toml
	@command -v "$(PYTHON)" >/dev/null 2>&1 || { echo "make: no Python called $(PYTHON) was found; install Python 3.11 or newer, or say where it is: make PYTHON=/path/to/python3" >&2; exit 1; }
	@"$(PYTHON)" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "make: deabayes needs Python 3.11 or newer, but $(PYTHON) is $$("$(PYTHON)" -c '$(VERSION)'); install a newer one or say where it is: make PYTHON=/path/to/python3.11" >&2; exit 1; }
	@echo "Setting up $(VENV) (once, a few minutes)"
	@[ "$$("$(PYTHON)" -c '$(VERSION)')" = "$$($(BIN)/python -c '$(VERSION)' 2>/dev/null)" ] || "$(PYTHON)" -m venv --clear $(VENV)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-input --require-hashes -r requirements.lock
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-input --no-deps --no-build-isolation -e .
	@touch $@

# A file of tests stays on one core: its fixtures are made once.
test: $(READY)  ## the whole test suite
	@$(BIN)/python -m pytest -n $(CORES) --dist loadfile

quick: $(READY)  ## a preview run of the tubular study, about two minutes
	@$(SNAKEMAKE) --workflow-profile workflow/profiles/quick
	@echo "Preview report: $(CURDIR)/$(QUICK_REPORT)"

extended: $(READY)  ## also the studies that fit all records at once; long
	@$(SNAKEMAKE) --workflow-profile workflow/profiles/extended
	@echo "Report: $(CURDIR)/$(REPORT)"

bench: $(READY)  ## time against other solvers and samplers
	@for script in benchmarks/*.py; do echo "== $$script"; $(BIN)/python -m "benchmarks.$$(basename "$$script" .py)" || exit 1; done

lint: $(READY)  ## style, types, layers, workflow
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check --quiet .
	@$(BIN)/snakefmt --check Snakefile workflow
	@$(BIN)/snakemake --lint
	@$(BIN)/lint-imports
	@$(BIN)/mypy

docs: $(READY)  ## the documentation, in site/
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet
	@echo "Documentation: $(CURDIR)/site/index.html"

validate: $(READY)  ## the long statistical checks, a day or two; tables and figures go to docs/validation
	@$(BIN)/python -m tests.validation.calibration voigt_kelvin_2 --replicates $(REPLICATES)
	@$(BIN)/python -m tests.validation.calibration kv_gm_1 --replicates $(REPLICATES)
	@$(BIN)/python -m tests.validation.calibration ogden_1 --replicates $(REPLICATES)
	@for units in 1 2 3; do \
		$(BIN)/python -m tests.validation.recovery membrane $$units --replicates $(MEMBRANES) --processes $(CORES) || exit 1; \
	done
	@for variant in white dense dense_white iid iid_white; do \
		$(BIN)/python -m tests.validation.recovery membrane 1 --variant $$variant --replicates $(MEMBRANES) --processes $(CORES) || exit 1; \
	done
	@$(BIN)/python -m tests.validation.recovery tubular 2 --replicates $(TUBES) --processes $(CORES)
	@for units in 1 2; do $(BIN)/python -m tests.validation.recovery strip $$units --replicates $(STRUCTURES) --processes $(CORES) || exit 1; done
	@for terms in 1 2; do $(BIN)/python -m tests.validation.recovery rest $$terms --replicates $(STRUCTURES) --processes $(CORES) || exit 1; done
	@for units in 1 2; do $(BIN)/python -m tests.validation.recovery motion $$units --replicates $(STRUCTURES) --processes $(CORES) || exit 1; done
	@$(BIN)/python -m tests.validation.two_seeds --processes $(CORES)
	@for case in $(ORDER_CASES); do \
		$(BIN)/python -m tests.validation.order_selection $$case --replicates $(ORDERS) --processes $(CORES) || exit 1; \
	done
	@$(BIN)/python -m tests.validation.nested --case A
	@$(BIN)/python -m tests.validation.population --replicates $(POPULATIONS) --processes $(CORES)
	@$(BIN)/python -m tests.validation.population --noise
	@$(BIN)/python -m tests.validation.candidate_information
	@$(BIN)/python -m tests.validation.nist --processes $(CORES)
	@$(BIN)/python -m tests.validation.nist_reference
	@$(BIN)/python -m tests.validation.summary

data: $(READY)  ## download the public data sets, checked by SHA-256
	@$(BIN)/deabayes data

clean:  ## remove results, caches and the environment; data stay
	@rm -rf $(VENV) .snakemake results site .pytest_cache .ruff_cache .mypy_cache .import_linter_cache
	@find src tests -name __pycache__ -type d -prune -exec rm -rf {} +

help:
	@sed -n 's/^\([a-z]*\):[^#]*## /  make \1\t/p' $(firstword $(MAKEFILE_LIST)) | expand -t 18
