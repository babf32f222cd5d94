# Two commands matter: `make book` builds the site, `make test` tests everything but what `make test-slow` measures again.
#   make lab        to read in JupyterLab: opens executed copies of the pages (`make lab-copies` builds them and opens nothing)
#   make edit       to write: opens the sources in book/; `make clear` takes out what a run left in them
#   make notebooks  for any other viewer, what the site offers for download: build/notebooks/
#   make course     graded exercises, a folder for nbgrader: build/course/release/ has blanks, teacher/ solutions
#   make decks      three lectures as slides: build/decks/
# With SOLUTIONS=1, `make book` shows the solutions of graded exercises, too, and copies and downloads hold solutions.
#
# The size of torch: on Linux its default wheel brings about 5 GB of CUDA libraries. Without an NVIDIA card, take the CPU
# wheel (under 1 GB) instead:   make book TORCH_INDEX=https://download.pytorch.org/whl/cpu

PYTHON ?= $(shell command -v python3.11 || command -v python3)
TORCH_INDEX ?=
JOBS ?= 2
export SOLUTIONS ?=

BIN := .venv/bin
INSTALLED := .venv/installed
PYTEST := $(BIN)/python -m pytest -q
UNIT = $(PYTEST) -n $(JOBS) --dist loadfile --no-loadscope-reorder -m "not slow" --ignore=tests/site --ignore=tests/book tests
PIP := $(BIN)/python -m pip --disable-pip-version-check
# uv needs a tenth of pip's time, but does not read pip's settings: it is told of the mirrors and certificates that pip
# knows, and takes the best version that any index has, as pip does.
SETTINGS := $(PIP) config list | sort -r | sed -n -e 's/^[^.]*\.//; s/\\n/ /g; /^find-links=/s/ /,/g' \
  -e 's/^index-url=/export UV_DEFAULT_INDEX=/p; s/^extra-index-url=/export UV_INDEX=/p' \
  -e 's/^find-links=/export UV_FIND_LINKS=/p; s/^cert=/export SSL_CERT_FILE=/p'
UV := $(BIN)/uv pip install --python $(BIN)/python --index-strategy unsafe-best-match --quiet -c constraints.txt

# One thread per process: JOBS processes run side by side, and small sparse solves gain nothing from more threads.
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1
export PYDEVD_DISABLE_FILE_VALIDATION ?= 1
# A hundred processes import the same packages, and uv compiles none: the first one compiles for all, unless it is
# forbidden to. Torch, Matplotlib and pyvista take 8 seconds from their sources, 3 compiled.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: book test test-unit test-kernels test-site test-slow lab lab-copies edit notebooks course decks clear clean
.DELETE_ON_ERROR:

book: $(INSTALLED)
	$(BIN)/python -m book.builder.build_book --jobs $(JOBS)
	@echo "The book: _build/html/index.html (serve it with: $(BIN)/python -m http.server --directory _build/html)"

# One after the other: side by side on two cores, browsers and processes wait for each other, and all takes longer.
test: $(INSTALLED)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	@$(MAKE) --no-print-directory --keep-going test-unit test-site

test-unit: $(INSTALLED)
	$(UNIT)

# The unit tests five times, as other processors round: weekly, and before a release.
test-kernels: $(INSTALLED)
	$(BIN)/python tests/kernels.py $(UNIT)

# Tests of tests/book read pages that a build has executed.
test-site: $(INSTALLED)
	$(BIN)/python -m book.builder.build_book --jobs $(JOBS) --lab
	$(PYTEST) -n $(JOBS) --dist loadgroup -rs -m "not slow" tests/book tests/site

# What measures again, and axe-core on every page, wide and narrow, by day and in the dark: weekly, and before a release.
test-slow: $(INSTALLED)
	$(PYTEST) -n $(JOBS) -m slow --ignore=tests/site tests
	$(BIN)/python -m book.builder.build_book --jobs $(JOBS)
	REQUIRE_CHROMIUM=1 $(PYTEST) -n $(JOBS) --dist loadgroup -m slow tests/site

lab-copies: $(INSTALLED)
	$(BIN)/python -m book.builder.lab_copies --jobs $(JOBS)

lab: lab-copies
	$(BIN)/jupyter lab --ServerApp.root_dir=build/lab --LabApp.default_url=/lab/tree/index.ipynb

edit: $(INSTALLED)
	$(BIN)/jupyter lab book

clear: $(INSTALLED)
	$(BIN)/python -m book.builder.clear_pages

notebooks: $(INSTALLED)
	$(BIN)/python -m book.builder.lab_copies --plain --jobs $(JOBS)

course: $(INSTALLED)
	$(BIN)/python -m book.builder.course

decks: $(INSTALLED)
	$(BIN)/python -m book.builder.decks --jobs $(JOBS)
	@echo "Slides: $(BIN)/python -m http.server --directory build/decks, then http://localhost:8000/opening.html"

clean:
	rm -rf _build build .venv

$(INSTALLED): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "make: Python 3.11 or newer is needed; name one with: make PYTHON=/path/to/python3.11"; exit 1; }
	@$(PYTHON) -m venv .venv \
	  || { echo "make: no virtual environment could be created; on Debian: apt-get install python3-venv"; exit 1; }
	@echo "Installing into .venv: 3 GB, about a minute (some 5 GB more where torch comes with CUDA, see the top of the Makefile)"
	@$(PIP) install --retries 2 --timeout 15 --quiet -c constraints.txt uv && eval "$$($(SETTINGS))" \
	  && { test -z "$(TORCH_INDEX)" || $(UV) --default-index $(TORCH_INDEX) torch; } && $(UV) -e '.[test]' \
	  || { echo "make: the installation failed; above is why. It needs the network (or a pip mirror) and 3 GB of disk, 8 where torch comes with CUDA."; exit 1; }
	@touch $@
