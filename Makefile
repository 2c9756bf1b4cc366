# Everything is installed into .venv of this folder and nowhere else. Required: make and Python 3.11 or later.

PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
RUN    ?= results/reference

.DEFAULT_GOAL := help
.PHONY: help core debug bench test nightly fuzz lint docs perf report compare experiment clean

help:                 ## list the targets
	@grep -hE '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*##/\t/' | expand -t 12

# A stamp file for each set of extras, which is installed again when the metadata or the pinned versions change.
$(VENV)/.field: EXTRAS := bench,field,copyleft
$(VENV)/.test:  EXTRAS := bench,field,copyleft,formats,test
$(VENV)/.dev:   EXTRAS := bench,field,copyleft,formats,test,heavy,commercial,dask,docs,dev
$(VENV)/.docs:  EXTRAS := docs
$(VENV)/.field $(VENV)/.test $(VENV)/.dev $(VENV)/.docs: pyproject.toml constraints.txt
	@echo "installing $(EXTRAS) into $(VENV)"
	@(s=0; while sleep 5; do s=$$((s + 5)); echo "  $$s s"; done) & trap "kill $$!" EXIT; \
	if command -v uv >/dev/null 2>&1; then \
	  test -x $(BIN)/python || uv venv --quiet --python $(PYTHON) $(VENV); \
	  uv pip install --quiet --compile-bytecode --python $(BIN)/python -c constraints.txt -e '.[$(EXTRAS)]'; \
	else \
	  test -x $(BIN)/python || $(PYTHON) -m venv $(VENV); \
	  $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[$(EXTRAS)]'; \
	fi
	@touch $@

# Without a C compiler, the installation has built the libraries with a compiler that it downloads.
core: $(VENV)/$(if $(ALL)$(wildcard $(VENV)/.dev),.dev,.test) ## compile the C cores whose sources have changed
	$(BIN)/python solvers/core/compile_core.py

# Tests of the cores; not those of other libraries, in which the sanitizers find errors, too.
CORE_TESTS := $(wildcard $(patsubst %,tests/solvers/test_%.py,core box_* contract accelerated_projection) \
  $(patsubst %,tests/paper/test_%.py,equation_7* figure_1*) \
  $(patsubst %,tests/piezo_model/test_%.py,bank model_core sensor self_learning continuous_learning data_basis))
debug: $(VENV)/.dev   ## compile the C cores with sanitizers, and run their tests
	$(BIN)/python solvers/core/compile_core.py --debug
	LD_PRELOAD="$$($${CC:-cc} -print-file-name=libasan.so)" ASAN_OPTIONS=detect_leaks=0:alloc_dealloc_mismatch=0 \
	  $(BIN)/python -m pytest -q -p no:cacheprovider $(CORE_TESTS); status=$$?; \
	  $(BIN)/python solvers/core/compile_core.py --fresh; exit $$status

bench: $(VENV)/.field ## set up, then race the default field; RECORDING=stage.csv: on your own data
	$(BIN)/piezobench race $(if $(RECORDING),--recording "$(RECORDING)") $(OPTIONS)

# A test that hangs ends the run, with a traceback.
PYTEST := $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder --max-worker-restart 0
test: core            ## set up, then run the tests; ALL=1: with all libraries, the slow tests too, and none skipped
	$(if $(ALL),PIEZOBENCH_ALL_TESTS=1) $(PYTEST) $(if $(ALL),-m 'not nightly') $(TESTS)

nightly: $(VENV)/.dev core ## run the tests that take minutes
	$(PYTEST) -m nightly -o faulthandler_timeout=3600

fuzz: $(VENV)/.dev core ## try hostile input for a quarter of an hour, or for FUZZ_SECONDS
	PYTHONPATH=.:tests:tests/piezo_model $(BIN)/python tests/bench/test_fuzz.py

lint: $(VENV)/.dev    ## style and types
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/clang-format --dry-run -Werror $$(find bench examples piezo_model solvers tests -name '*.[ch]')
	$(BIN)/mypy
	$(BIN)/mypy --config-file tests/mypy.ini
	$(BIN)/mypy $(wildcard $(patsubst %,examples/%/*.py,adapters comparison paper performance problem_sets))

docs: $(VENV)/.docs   ## build the documentation into site/
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict

perf: core            ## time the hot kernels beside vectorised NumPy, the slowest sample, and banks
	for each in kernels bank; do $(BIN)/python examples/performance/$$each.py || exit 1; done

report: $(VENV)/.field ## write the report of RUN=results/<run> again
	$(BIN)/piezobench report $(RUN)

compare: $(VENV)/.field ## compare the runs A=results/<run> and B=results/<run>
	@test -n "$(A)" -a -n "$(B)" || { echo "name two runs: make compare A=results/<run> B=results/<run>" >&2; exit 2; }
	$(BIN)/piezobench compare $(A) $(B) $(if $(OUT),--out $(OUT))

experiment: $(VENV)/.field ## the paper's Fig. 4 on a simulated stage, into results/paper
	$(BIN)/python examples/paper/staircase.py

clean:                ## remove caches of compiled code and tools
	find bench piezo_model solvers tests examples -name __pycache__ -type d -prune -exec rm -r {} +
	rm -rf .pytest_cache .mypy_cache .ruff_cache .hypothesis build site *.egg-info solvers/core/_core_* piezo_model/core/_core_*
