# make run: everything for the main job. make test: everything for the tests. make docs: the site.
# PIP_FLAGS carries extras for pip, such as "-c constraints.txt". On Linux, pip's PyTorch comes with
# CUDA, some gigabytes; without an NVIDIA GPU, take the build for the CPU:
#   make test PIP_FLAGS="--extra-index-url https://download.pytorch.org/whl/cpu"
PYTHON ?= python3
VENV ?= .venv

run:
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/pip install $(PIP_FLAGS) .
	$(VENV)/bin/latentmotion generate "a person walks forward and sits down" --seconds 4 -o walk.bvh walk.html

test:
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/pip install $(PIP_FLAGS) -e ".[dev]"
	$(VENV)/bin/python -m pytest -n auto --dist loadfile

# Tests of the rooms that a sentence passes through on its way to a file, in an environment at hand.
CORE = cleanup control diffusion engine formats kinematics language measure pipeline representation storage
core:
	$(PYTHON) -m pytest -n auto --dist loadfile $(CORE:%=tests/%)

# One table that anyone can check: trained and measured from the data in the repository, an hour of one
# core and 3 GB of disk. The same command again resumes it.
table:
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/pip install $(PIP_FLAGS) ".[train]"
	$(VENV)/bin/latentmotion experiment run pack --data data/starter.pack --budget small --evaluator scorer -o table

lint:
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/ruff check .
	$(VENV)/bin/pyright --pythonpath $(VENV)/bin/python
	$(VENV)/bin/lint-imports
	$(VENV)/bin/check-jsonschema --builtin-schema vendor.github-workflows .github/workflows/*.yml
	$(VENV)/bin/zizmor --offline --quiet .github

docs:
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/pip install $(PIP_FLAGS) -e ".[docs]"
	NO_MKDOCS_2_WARNING=1 $(VENV)/bin/python -m mkdocs build --strict --quiet

.PHONY: run test core table lint docs
