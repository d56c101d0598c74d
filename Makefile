# make demo, make test: each, alone, makes the environment, installs what it needs, and runs.
# make pictures: the pictures of docs/.
# make docs: the site, into docs/_build/html, and a check of its links, names and search; it needs Node.js.
# make gallery: the pictures of examples/, for the site.
# make tables: the tables of docs/, each by the command in front of it; some minutes.
# make lint, make types: Python and the viewer's JavaScript; they need npm for the latter.
# make test-fast: the tests that need no browser, study or long run; about a minute on two cores.
# make sanitize: the kernel's tests and 100,000 hostile calls under the address and
# undefined-behaviour sanitizers; gcc, Linux.
# make franka: Franka's client drives a simulator of its interface; needs PyPI for both, on Linux.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
CORE := $(VENV)/.core
INSTALLED := $(VENV)/.installed

FRANKA := $(VENV)/.franka
NODE := node_modules/.package-lock.json
KERNEL_TESTS := tests/test_compiled.py tests/test_account.py tests/test_stack.py tests/test_given_rows.py tests/test_rows.py tests/test_priority.py tests/test_qp_hierarchy.py tests/test_approach.py tests/test_planner.py tests/test_dampers.py tests/test_limits_at_speed.py tests/test_trocar_speed.py
SANITIZED = PYTHONPATH=$(VENV)/sanitized LD_PRELOAD="$$(gcc -print-file-name=libasan.so) $$(gcc -print-file-name=libubsan.so)" \
	ASAN_OPTIONS=detect_leaks=0 OMP_NUM_THREADS=1
DOCS := $(VENV)/.docs
MOVING := fps=6,scale=720:-1:flags=lanczos,split[a][b];[a]palettegen=max_colors=64:stats_mode=diff[p];[b][p]paletteuse=dither=none:diff_mode=rectangle

.PHONY: demo docs pictures gallery tables test test-fast sanitize franka lint types check clean

demo: $(CORE)
	$(BIN)/rcmqp reproduce --out results
	@$(BIN)/python -c 'import pathlib, webbrowser as w; page = pathlib.Path("results/index.html").resolve(); w.open(page.as_uri()) or print("open", page)'

pictures: $(INSTALLED) demo
	cp results/fig3_errors.png results/fig2_trajectories.png results/helix_lwa3.png results/helix_meka_a2.png docs
	$(BIN)/rcmqp video results/lwa3_1ms.h5 results/lwa3_1ms_hierarchical_qp.h5 --camera page --speed 4 --size 1200x750 --out results/viewer.mp4
	ffmpeg -v error -y -i results/viewer.mp4 -vf "$(MOVING)" docs/viewer.gif
	$(BIN)/python docs/starts.py

docs: $(DOCS)
	rm -rf docs/_build
	$(BIN)/python -m sphinx -W --keep-going -q -b html -d docs/_build/doctrees docs docs/_build/html
	$(BIN)/python docs/check.py docs/_build/html
	node docs/search.mjs docs/_build/html

gallery: $(INSTALLED)
	$(BIN)/python examples docs/gallery
	rm -f docs/gallery/*.pdf

tables: $(INSTALLED)
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/doc_tables.py
	$(BIN)/python benchmarks/measures_page.py

test: $(INSTALLED) $(NODE)
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --dist loadfile

test-fast: $(INSTALLED)
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile -m 'not slow'

franka: $(FRANKA)
	OMP_NUM_THREADS=1 timeout 900 $(BIN)/python -m pytest tests/franka

sanitize: $(INSTALLED)
	rm -rf build $(VENV)/sanitized
	CFLAGS="-fsanitize=address,undefined,float-cast-overflow -fno-sanitize-recover=all -g" \
		$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --target $(VENV)/sanitized .
	rm -rf build  # its objects are not for others
	$(SANITIZED) $(BIN)/pytest $(KERNEL_TESTS)
	$(SANITIZED) $(BIN)/python benchmarks/fuzz.py --calls 100000

lint: $(INSTALLED) $(NODE)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	node_modules/.bin/oxlint

types: $(INSTALLED) $(NODE)
	$(BIN)/mypy
	node_modules/.bin/tsc

check: lint types test

$(CORE): pyproject.toml setup.py rcmqp/__init__.py $(wildcard rcmqp/kernel/*)
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "rcmqp needs Python 3.11 or newer, $(PYTHON) is %s" % sys.version.split()[0])'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	touch $@

$(INSTALLED): $(CORE)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	touch $@

$(NODE): package.json package-lock.json
	@command -v npm >/dev/null || { echo "make lint and make types need Node.js 20 or newer with npm for the viewer's scripts: apt-get install nodejs npm" >&2; exit 1; }
	npm ci --ignore-scripts --no-audit --no-fund
	touch $@

$(DOCS): $(INSTALLED)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[docs]'
	touch $@

$(FRANKA): $(INSTALLED)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check 'pylibfranka==0.21.3' || \
		{ echo "make franka needs Franka's client, pylibfranka, from PyPI; make test does without" >&2; exit 1; }
	touch $@

clean:
	rm -rf $(VENV) .venv-franka node_modules build dist *.egg-info results docs/_build docs/generated
