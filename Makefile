# make demo, make test: each, alone, makes the environment, installs, and runs. make pictures: docs/.
# make gallery: the pictures of examples/, for the site.
# make tables: the tables of README.md and docs/, each by the command in front of it; some minutes.
# make franka: Franka's client drives a simulator of its interface; needs PyPI for both, on Linux.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed

FRANKA := $(VENV)/.franka

.PHONY: demo pictures gallery tables test franka lint types check clean

demo: $(INSTALLED)
	$(BIN)/rcmqp reproduce --out results

pictures: demo
	cp results/fig3_errors.png results/fig2_trajectories.png results/helix_lwa3.png results/helix_meka_a2.png docs
	$(BIN)/rcmqp snapshot results/lwa3_1ms.h5 results/lwa3_1ms_hierarchical_qp.h5 --camera page --time 12 --out docs/viewer.png

gallery: $(INSTALLED)
	$(BIN)/python examples docs/gallery
	rm -f docs/gallery/*.pdf

tables: $(INSTALLED)
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/doc_tables.py

test: $(INSTALLED)
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --dist loadfile

franka: $(FRANKA)
	OMP_NUM_THREADS=1 timeout 900 $(BIN)/python -m pytest tests/franka

lint: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(INSTALLED)
	$(BIN)/mypy

check: lint types test

$(INSTALLED): pyproject.toml setup.py $(wildcard rcmqp/kernel/*)
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "rcmqp needs Python 3.11 or newer, $(PYTHON) is %s" % sys.version.split()[0])'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	touch $@

$(FRANKA): $(INSTALLED)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check 'pylibfranka==0.21.3' || \
		{ echo "make franka needs Franka's client, pylibfranka, from PyPI; make test does without" >&2; exit 1; }
	touch $@

clean:
	rm -rf $(VENV) .venv-franka build dist *.egg-info results
