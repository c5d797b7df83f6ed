# Each target but clean first makes .venv and installs into it; nothing is installed twice.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.installed

.DELETE_ON_ERROR:
.PHONY: setup demo test check lint types bench figures clean

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

check: lint types test

bench: setup
	$(BIN)/swimmer-mj bench

figures: setup
	$(BIN)/swimmer-mj figures

clean:
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
