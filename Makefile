# The project's commands. Each one sets up the environment by itself on a fresh clone.
#   make repro [PROFILE=quick]   the pipeline; PROFILE overlays profiles/<name>.yaml and leaves the working tree clean
#   make repro JSON=1            the same; every line of the progress is a JSON object
#   make repro STAGE=...         one stage, such as train_stroke_dynamics@marker, and what it reads as far as out of date
#   make repro SEEDS=5 STAGE=...  one stage with five seeds, to compare with another five (docs/reviewing.md)
#   make test                    the whole test suite
#   make check                   format, lint, types
#   make docs                    the documentation as a site, into site/
#   make tutorials               run the tutorials, and keep what they print and show for the site
#   make base                    the base of the goal planner (hours; the UNet's training goes on where it was interrupted)
#   make deps                    write into dvc.yaml the dependencies that follow from code and params.yaml
#   make bench                   the benchmarks, side by side with the slow references
#   make studies [WORLDS=0.1]    the blind benchmark of the diagnosis (hours), or a share of them; resumes where it was interrupted
#   make clean                   remove the pipeline's outputs and caches; what you brought, environment, DVC's cache and
#                                MLflow's history stay
#   make env                     the environment alone
PYTHON ?= python3
PROFILE ?=
WORLDS ?= 1
SEEDS ?=
STAGE ?=
JSON ?=

BIN := .venv/bin
PIP_INSTALL := $(BIN)/python -m pip install --disable-pip-version-check --no-compile
STAMP := .venv/.installed-$(shell cat pyproject.toml constraints.txt | git hash-object --stdin)

# Two threads for each process: with more threads than cores, a training step takes several times longer.
export OMP_NUM_THREADS ?= 2
export NUMBA_NUM_THREADS ?= 2
# Where networks compute; the published ones on a GPU if there is one. Training has its own parameter, `accelerator`.
export PENTIMENTO_DEVICE ?= $(if $(filter full,$(PROFILE)),auto,cpu)
# Without Python's bytecode files, every stage starts seconds later.
export PYTHONDONTWRITEBYTECODE :=
# No network access.
export HF_HUB_OFFLINE ?= 1
export HF_HUB_DISABLE_PROGRESS_BARS ?= 1
export MLFLOW_DISABLE_TELEMETRY ?= true
export MLFLOW_ALLOW_PICKLE_DESERIALIZATION ?= false
export DO_NOT_TRACK ?= true

.PHONY: repro base docs tutorials deps test coverage check bench studies licences clean env
.DELETE_ON_ERROR:

repro: env
	@$(BIN)/python -m $(if $(SEEDS),pipelines._seeds $(SEEDS) "$(STAGE)",pipelines._repro $(if $(JSON),--json) $(if $(STAGE),--stage "$(STAGE)")) $(PROFILE)

# One thread for each of the two processes: with more threads than cores, tests take several times longer. The tests of a
# file stay together, because they share fixtures that are slow to create.
test coverage: export OMP_NUM_THREADS = 1
test coverage: export NUMBA_NUM_THREADS = 1

test: env
	$(BIN)/python -m pytest --numprocesses 2 --dist loadfile --no-loadscope-reorder

coverage: env
	$(BIN)/python -m pytest --numprocesses 2 --dist loadfile --no-loadscope-reorder --cov --cov-report term:skip-covered

licences: env
	( printf '# Licences\n\nOf what `make env` installs, as the packages themselves say; written by `make licences`.\n\n' && \
	$(BIN)/pip-licenses --from=mixed --with-system --format=markdown --ignore-packages pentimento setuptools | \
	grep -v '^|  *|' ) > docs/licences.md

check: env
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/python -m pytest -q tests/test_layering.py tests/pipelines/test_stages.py

docs: export NO_MKDOCS_2_WARNING = 1
docs: env
	$(BIN)/python -m mkdocs build --quiet --strict
	@echo "Open site/index.html."

tutorials: env
	$(BIN)/python docs/site/tutorials.py

base: env
	PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/dvc repro base/dvc.yaml

deps: env
	$(BIN)/python -m pipelines._deps

bench: env
	$(BIN)/python -m benchmarks

studies: env
	$(BIN)/python -m studies.blind.table strokes --worlds $(WORLDS)
	$(BIN)/python -m studies.blind.table pushes --worlds $(WORLDS)
	$(BIN)/python -m studies.stroke_models

clean: env
	$(BIN)/python -m pipelines._clean
	rm -rf .profiles .pentimento .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -not -path './.venv/*' -prune -exec rm -rf {} +

env: $(STAMP)

# Numba compiles here what the first stages need, or these would take a minute longer.
# Measured on a fresh clone: the pip that comes with Python 3.11 takes twice as long as the pinned one, and it compiles
# bytecode on one core; afterwards, on all, that is a minute, which the first run of every stage gives back. A package
# that was being copied when an install was interrupted has no RECORD: forgetting it makes pip redo it.
$(STAMP):
	$(BIN)/python -m pip --version >/dev/null 2>&1 || $(PYTHON) -m venv --clear .venv
	find .venv/lib -name '*.dist-info' -prune ! -exec test -e {}/RECORD \; -exec rm -rf {} +
	$(PIP_INSTALL) --quiet -c constraints.txt pip
	$(PIP_INSTALL) -c constraints.txt -e ".[train,drawings,distributed,s3,c3d,voice,arm,docs,dev]"
	$(BIN)/python -m compileall -q -j 0 -x py312_intrinsics .venv/lib # PyTorch ships that one for later Pythons only
	$(BIN)/python -m pipelines._compile
	rm -f .venv/.installed-*
	touch $@
