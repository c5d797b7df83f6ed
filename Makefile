# Each target but clean first makes .venv and installs into it; nothing is installed twice.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.installed

.DELETE_ON_ERROR:
.PHONY: setup demo test check lint types docs bench figures release clean

setup: $(STAMP)

$(STAMP): pyproject.toml tools/setup.sh
	PYTHON="$(PYTHON)" tools/setup.sh $(VENV)
	touch $@

demo: setup
	$(BIN)/swimmer-mj demo

test: setup
	$(BIN)/python -m pytest

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: setup
	tools/types.sh $(VENV)

docs: setup
	$(BIN)/python -m sphinx -c docs -E -W -q . build/site
	MUJOCO_GL=disabled $(BIN)/python tools/check_site.py build/site
	@echo "the site: build/site/index.html"

check: lint types docs test

bench: setup
	$(BIN)/swimmer-mj bench

figures: setup
	$(BIN)/swimmer-mj figures

release: setup
	$(BIN)/python tools/release.py

clean:
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
