# The verbs of mvmatch. Each sets up what it needs from nothing but Python >= 3.11 and Rust.
.DEFAULT_GOAL := help
.PHONY: help setup demo test test-deep lint bench bench-accuracy bench-ablation bench-confidence bench-paper bench-sfm fuzz fuzz-long fmt clean
SHELL := /bin/bash

# The first interpreter that runs, is new enough and can make virtual environments.
PYTHON ?= $(shell for p in python3 python3.14 python3.13 python3.12 python3.11; do \
	$$p -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && { echo $$p; break; }; done)
VENV := .venv
BIN := $(VENV)/bin
CARGO_TEST := cargo test --workspace --exclude mvmatch-python --features av1-motion/trace
RUST_SOURCES := $(shell find crates -name '*.rs' -o -name 'Cargo.toml') Cargo.toml Cargo.lock

help:
	@echo "make demo    render a short synthetic drive, encode it, reconstruct it, compare with the truth"
	@echo "make test    all tests: Rust, Python"
	@echo "make test-deep   the tests of learned matchers; fetches PyTorch (some GB)"
	@echo "make lint    rustfmt, clippy, ruff, pyright, import-linter, stubtest"
	@echo "make bench   speed of the parser and of the front ends"
	@echo "make bench-accuracy   points and poses of all methods against the truth (ACCURACY=options)"
	@echo "make bench-ablation   the same for preset default with one part off at a time"
	@echo "make bench-paper   the paper's protocol: tables, figures and a page (PAPER=file of settings)"
	@echo "make bench-sfm   whole runs, from input to model, beside SIFT (SFM=options)"
	@echo "make bench-confidence   the confidence in vectors against how many are right"
	@echo "make fuzz    every fuzz target for FUZZ_SECONDS (60); make fuzz-long reads damaged files"
	@echo "make fmt     format all sources"
	@echo "make setup   only the environment in $(VENV)"

setup: $(VENV)/core.stamp

$(BIN)/python:
	@test -n "$(PYTHON)" || { echo "Python >= 3.11 with the venv module was not found. Install it or run: make PYTHON=/path/to/python3 ..." >&2; exit 2; }
	@command -v cargo >/dev/null || { echo "cargo was not found. Install Rust from https://rustup.rs" >&2; exit 2; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade "pip>=24"

# Dependencies: only when pyproject.toml changes.
$(VENV)/dependencies.stamp: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet "maturin>=1.9.4,<2"
	VIRTUAL_ENV=$(abspath $(VENV)) $(BIN)/maturin develop --release --extras dev,encoders
	@touch $@

# The compiled module: only when a Rust source changes. Python sources are used in place.
$(VENV)/core.stamp: $(VENV)/dependencies.stamp $(RUST_SOURCES)
	VIRTUAL_ENV=$(abspath $(VENV)) $(BIN)/maturin develop --release --skip-install
	@touch $@

demo: setup
	$(BIN)/mvmatch demo demo

test: setup
	$(CARGO_TEST)
	$(BIN)/python -m pytest

# What `make test` skips without PyTorch.
test-deep: setup
	VIRTUAL_ENV=$(abspath $(VENV)) $(BIN)/maturin develop --release --extras deep
	$(BIN)/python -m pytest tests/unit/test_learned.py

lint: setup
	cargo fmt --all --check
	cargo clippy --workspace --all-targets --quiet -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --no-deps --quiet -p av1-motion -p motion-tracks
	cargo clippy --workspace --all-targets --features av1-motion/trace,mvmatch-python/trace --quiet -- -D warnings
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright
	$(BIN)/lint-imports --no-cache
	cd $(VENV) && bin/python -m mypy.stubtest mvmatch._core --ignore-disjoint-bases

# Real footage where it is at hand (SHARED), else what the demo renders.
SHARED ?= $(or $(MVMATCH_SHARED),../shared)
KITTI := $(SHARED)/sequences/kitti-b
BENCH_FRAMES ?= $(if $(wildcard $(KITTI)/images),$(KITTI)/images,demo/images)
BENCH_STREAM ?= $(if $(wildcard $(KITTI)/images),$(SHARED)/sequences/streams/kitti-b.svt-flat-p8.ivf,demo/encoded.ivf)
BENCH_CAMERA ?= $(if $(wildcard $(KITTI)/images),--camera $(KITTI)/calib.txt)

# High and low rates, small and large pictures; what is not there is left out.
BENCH_CLIPS ?= $(or $(wildcard $(addprefix $(SHARED)/sequences/streams/,kitti-b.libaom-good.ivf kitti-b.libaom-rt.ivf \
	kitti-b.svt-flat-p8.ivf kitti-b.svt-ra-p6.ivf fox.libaom-rt.ivf fox.svt-flat-p10.ivf)),$(BENCH_STREAM))

bench: setup
	test -d $(BENCH_FRAMES) || $(BIN)/mvmatch demo demo
	cargo build --release -p av1-motion --example count_vectors
	@if command -v dav1d >/dev/null; then $(BIN)/python tools/compare_parsers.py $(BENCH_CLIPS); \
	else echo "dav1d is not installed: the parser is not compared with it"; fi
	@if command -v inspect >/dev/null; then $(BIN)/python tools/compare_inspect.py $(BENCH_CLIPS); \
	else echo "libaom's inspect is not installed: reading vectors is not compared with it"; fi
	$(BIN)/python tools/compare_threads.py $(BENCH_STREAM)
	$(BIN)/python tools/compare_front_ends.py $(BENCH_FRAMES) --stream $(BENCH_STREAM) $(BENCH_CAMERA)

# Sequences with truth: SHARED/truth, or TRUTH=folder. All options: mvmatch bench accuracy --help.
TRUTH ?= $(SHARED)/truth
ACCURACY ?=

bench-accuracy: setup
	$(BIN)/mvmatch bench accuracy --data $(TRUTH) -o out/accuracy $(ACCURACY)

bench-ablation: setup
	$(BIN)/mvmatch bench accuracy --data $(TRUTH) -o out/ablation --methods 'svt-default*' $(ACCURACY)

SFM ?= --resamplings 5
SFM_DATA ?= $(TRUTH) $(SHARED)/sequences

bench-sfm: setup
	$(BIN)/mvmatch bench sfm $(addprefix --data ,$(SFM_DATA)) -o out/sfm $(SFM)

PAPER ?= configs/paper.toml
PAPER_DATA ?= $(SHARED)/sequences $(wildcard $(addprefix $(TRUTH)/,street_drive room_handheld))

bench-paper: setup
	$(BIN)/mvmatch bench $(PAPER) $(addprefix --data ,$(PAPER_DATA)) -o out/$(basename $(notdir $(PAPER)))

bench-confidence: setup
	$(BIN)/mvmatch bench confidence --data $(TRUTH) -o out/confidence --qualities 20,30,45

# Coverage-guided fuzzing on the stable toolchain: libFuzzer without a sanitizer (all code is safe
# Rust), with overflow checks and debug assertions. Needs a C++ compiler.
FUZZ := crates/av1-motion/fuzz
FUZZ_TARGETS ?= container headers tile file structure
FUZZ_SECONDS ?= 60
FUZZ_SEEDS := $(FUZZ)/target/seeds

fuzz: $(BIN)/python
	@command -v cargo-fuzz >/dev/null || cargo install cargo-fuzz --locked
	$(BIN)/python tools/fuzz_seeds.py $(FUZZ_SEEDS)
	cd $(FUZZ) && cargo fuzz build --fuzz-dir . --sanitizer none
	@for target in $(FUZZ_TARGETS); do \
		mkdir -p $(FUZZ)/corpus/$$target; \
		(cd $(FUZZ) && cargo fuzz run --fuzz-dir . --sanitizer none $$target corpus/$$target target/seeds/$$target -- \
			-max_total_time=$(FUZZ_SECONDS) -timeout=10 -rss_limit_mb=2048 -max_len=32768 -print_final_stats=1) || exit 1; \
	done

# Whole files damaged at random (MUTATIONS, SEED), and short streams cut at every byte. More streams:
# STREAMS=folder:folder.
MUTATIONS ?= 20000

fuzz-long:
	MUTATIONS=$(MUTATIONS) cargo test --profile checked -p av1-motion --test mutations -- --nocapture
	CUT_STEP=1 cargo test --profile checked -p av1-motion --test hostile

fmt: setup
	cargo fmt --all
	$(BIN)/ruff check --fix-only --quiet .
	$(BIN)/ruff format .

clean:
	rm -rf $(VENV) target demo out
