# The two commands a newcomer needs are `make demo` and `make test`; each sets up .venv by itself.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: demo test docs campaign bench bench-peers lint clean

demo: .venv/installed
	$(BIN)/oed run problems/choi_skid_steer.yaml

test: .venv/installed-dev
	$(BIN)/python -m pytest

# Every page, with all studies in the gallery and all cells executed, some minutes; docs/_build/html/index.html.
docs: .venv/installed-dev
	$(BIN)/python -m sphinx -W --keep-going -b html docs docs/_build/html

# Thousands of random problems, damaged files and signals; CAMPAIGN='--problems 500' for fewer, with a --seed.
campaign: .venv/installed-dev
	$(BIN)/python -m tests.campaign $(CAMPAIGN)

bench: .venv/installed-dev
	$(BIN)/python -m benchmarks --write

bench-peers: .venv-peers/installed
	.venv-peers/bin/python -m benchmarks.peers

lint: .venv/installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# The stamps record which install is in place; a changed pyproject.toml installs again.
.venv/bin/python:
	$(PYTHON) -c 'import sys; sys.exit("oed needs Python 3.11 or newer; run make PYTHON=python3.11") if sys.version_info < (3, 11) else None'
	$(PYTHON) -m venv .venv

# uv installs in a seventh of pip's time, by the index that pip is set to and the system's certificates; where it
# fails, pip does it all. Modules are compiled when they are first imported: most never are.
INDEX = $$($(BIN)/python -m pip config list | sed -n "s/^[^=]*\.index-url='\(.*\)'$$/\1/p" | head -n 1)
install = { $(BIN)/python -m pip install --quiet uv && \
	UV_SYSTEM_CERTS=1 UV_DEFAULT_INDEX="$${UV_DEFAULT_INDEX:-$(INDEX)}" \
	$(BIN)/uv pip install --quiet --python $(1)/bin/python $(2); } \
	2>/dev/null || $(1)/bin/python -m pip install --quiet --no-compile $(2)

.venv/installed: pyproject.toml | .venv/bin/python
	$(call install,.venv,--editable .)
	touch $@

.venv/installed-dev: pyproject.toml | .venv/bin/python
	$(call install,.venv,--editable '.[dev]')
	touch $@ .venv/installed

# The peers have a place of their own: the package does not need them.
.venv-peers/installed: pyproject.toml benchmarks/peers-requirements.txt | .venv/bin/python
	.venv/bin/python -m venv .venv-peers
	$(call install,.venv-peers,--editable . --requirement benchmarks/peers-requirements.txt)
	touch $@

clean:
	rm -rf .venv .venv-peers build dist docs/_build docs/generated .mypy_cache .pytest_cache .ruff_cache
