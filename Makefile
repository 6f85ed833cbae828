# Everything starts from here; `make help` says what there is.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
READY := $(VENV)/.ready
APT := DEBIAN_FRONTEND=noninteractive apt-get -qq -o Acquire::http::Timeout=20

.DEFAULT_GOAL := help
.PHONY: help venv extras ablations test test-slow gate gate-baseline measured mutants mutants-drawn lint site croissant gpu packages offline-bundle clean

help: ## this list
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1\t\2/p' $(MAKEFILE_LIST) | expand -t 24

venv: $(READY) ## a virtual environment with the locked dependencies and what developers need

$(INSTALLED): pyproject.toml constraints.txt .ci/install
	@.ci/install $(PYTHON) $(VENV)
	@touch $@

$(READY): $(INSTALLED)
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[dev]'
	@touch $@

ablations: $(INSTALLED) ## the paper's ablation table on six scenes of the package, and a longer run beside it
	$(BIN)/radiogs-bench run ablations --workers 2

lint: $(READY) ## style, types, which room may import which, how large functions are, links to lines of code, plain words, values without a command
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python .ci/structure.py
	$(BIN)/python .ci/code_links.py
	$(BIN)/python .ci/plain_words.py
	$(BIN)/python .ci/values.py

test: lint ## lint, then every test that is fast, in two processes (those for a GPU skip themselves)
	$(BIN)/python -m pytest -m "not slow" --numprocesses 2 --dist loadfile

extras: $(READY) ## Chromium and LaTeX (Debian, as root) and Ray, for the tests that skip themselves without
	@{ command -v chromium || command -v google-chrome; } >/dev/null && kpsewhich siunitx.sty >/dev/null \
	|| { $(APT) update && $(APT) install --yes chromium && $(APT) install --yes --no-install-recommends lmodern texlive-latex-recommended texlive-science; } >/dev/null 2>&1 \
	|| echo "make extras: Chromium or LaTeX is not here and could not be installed; tests of report.html in a browser, or of compiled documents, will skip themselves"
	@$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[cluster]' \
	|| echo "make extras: Ray could not be installed; its tests will skip themselves"

# The walk of the documents, which has the longest tests, comes first: so two processes end at about the same time.
WALKS := tests/bench/cli/test_walked_documents.py
SLOW = $(WALKS) $(filter-out $(WALKS),$(shell grep -rlE 'mark\.slow' --include='test_*.py' tests | sort))
ALONE = $(shell grep -rlE 'mark\.alone' --include='test_*.py' tests | sort)

test-slow: $(READY) ## the tests that take minutes; then those that compare speeds, with the machine to themselves
	$(BIN)/python -m pytest -m "slow and not alone" --numprocesses 2 --dist worksteal $(SLOW)
	$(BIN)/python -m pytest -m alone $(ALONE)

GATE := $(BIN)/radiogs-bench run ablations --scenes corner --rows ours --preset smoke --seeds 8 --threads 2

gate: $(READY) ## eight trainings of seconds beside the committed baseline: whether anything is worse, or computed otherwise
	$(GATE) --workers 2 --out out/gate-smoke
	$(BIN)/radiogs-bench gate out/gate-smoke --baseline .github/gate-smoke.json

gate-baseline: $(READY) ## the baseline of `make gate` anew, after a change that is intended
	$(GATE) --workers 2 --out out/gate-smoke
	$(GATE) --out out/rerun-smoke
	$(BIN)/radiogs-bench gate out/gate-smoke --baseline .github/gate-smoke.json --update --rerun out/rerun-smoke

measured: $(READY) ## records by age, and which of them this checkout would compute otherwise; NAME=ablations makes one anew
	$(BIN)/python .ci/measured.py $(NAME)

site: $(READY) ## the documentation as a site, in out/site
	$(BIN)/python -m mkdocs build --strict --quiet

croissant: ## the description of the committed scenes, validated in an environment of its own: mlcroissant brings stubs to mypy
	@$(PYTHON) -m venv .venv-croissant && .venv-croissant/bin/pip install --quiet --constraint constraints.txt mlcroissant==1.1.1
	@for each in datasets/radiogs_datasets/*.croissant.json; do .venv-croissant/bin/mlcroissant validate --jsonld $$each || exit 1; done

mutants: $(READY) ## break copies of the sources in known ways, and say which of them no test notices
	$(BIN)/python .ci/mutants.py

mutants-drawn: $(READY) ## break a hundred places drawn at random, in at most twenty minutes; COUNT and SEED choose others
	$(BIN)/python .ci/sample_mutants.py $(COUNT) $(if $(SEED),--seed $(SEED))

gpu: $(READY) ## prove the project on a CUDA card, part by part, into docs/gpu/
	$(BIN)/python .ci/gpu_check.py

packages: ## wheel and source distribution, in dist/; each is installed into an empty environment, and trains a model there
	.ci/packages $(PYTHON)

offline-bundle: $(READY) ## wheels for a machine with Python and PyTorch and no network, into out/offline
	$(BIN)/python .ci/offline_bundle.py

clean: ## remove the virtual environment and caches; results in out/ stay
	rm -rf $(VENV) .venv-croissant dist .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	find . -name __pycache__ -type d -not -path './.git/*' -prune -exec rm -rf {} +
