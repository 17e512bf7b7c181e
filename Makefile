# Everything from nothing: a virtual environment with pinned ROS 2 wheels, the colcon build, demo and tests.
# With ROS 2 Jazzy installed, `rosdep install` and `colcon build` do the same job without make: see README.md.

ifneq ($(words $(CURDIR)),1)
$(error the path of this folder holds a space, which make, CMake and virtual environments cannot handle: $(CURDIR))
endif

VENV := $(CURDIR)/.venv
BIN := $(VENV)/bin
STEP := @echo "=="

# The environment comes from .venv and install alone, whatever is sourced in the calling shell.
ifdef AMENT_PREFIX_PATH
unexport LD_LIBRARY_PATH
endif
unexport AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH PYTHONPATH PYTHONHOME
unexport MBAID_ROS_SOURCED _ROS_WHEELS_BOOTSTRAP_COMPLETE
# The tests start hundreds of processes: what one has compiled, the others need not compile again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help setup demo bags pictures test test-long test-basilisk mutants fuzz lint clean paper-table docs
.NOTPARALLEL:
.DELETE_ON_ERROR:

help:
	@echo "make setup   virtual environment, pinned packages and colcon build; then: . install/setup.bash"
	@echo "make demo    set-up, then identify a captured body on a live ROS 2 graph"
	@echo "make bags    set-up, then make the bags of bags/ anew"
	@echo "make pictures  set-up, then make the pictures of README and pages anew"
	@echo "make test    set-up, lint, types, then every test but the long ones, which make test-long runs"
	@echo "make test-basilisk  set-up, then exported parameters in Basilisk, which is installed for it"
	@echo "make mutants set-up, then mistakes in copies of the core, and those that no test notices (ARGS=\"--seed 7 --count 20\")"
	@echo "make fuzz    set-up, then damaged bags and other files through the executables (ARGS=\"--inputs N\")"
	@echo "make lint    set-up, lint and types"
	@echo "make docs    set-up, then the pages of docs/ as a site in build/docs (installs Sphinx for itself; Python 3.11 or later)"
	@echo "make clean   remove what the others made"
	@echo "make benchmark-NAME  set-up, then measure, and write the tables of a page in docs/ (ARGS=\"--seeds 10\", ARGS=--help)"
	@echo "             NAME: accuracy, model-errors, disturbances, speed, planning, orbit (an hour each on two cores), starts,"
	@echo "             hardware (an hour, of clones), honesty, benches, peers (half an hour), calibration (minutes);"
	@echo "             make paper-table likewise (seconds)"
	@echo "HASHES=1     with setup: only packages whose SHA-256 is in requirements.lock"
	@echo "PYTHON=...   the Python to build with, 3.10 to 3.13 (for the first set-up, or after make clean)"

setup: install/.built
	@echo "ready: . install/setup.bash"

demo: install/.built
	@. ./install/setup.sh && python3 scripts/demo.py

bags: install/.built
	@. ./install/setup.sh && python3 scripts/make_bags.py $(ARGS)

pictures: install/.built
	@. ./install/setup.sh && OPENBLAS_NUM_THREADS=1 python3 scripts/make_pictures.py

test: export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST
test: export OPENBLAS_NUM_THREADS := 1
test: lint
	$(STEP) "tests"
	@. ./install/setup.sh && pytest -n 2 --dist worksteal

test-basilisk: install/.built
	@$(BIN)/python -m pip install --quiet bsk==2.12.1
	@. ./install/setup.sh && pytest test/replay/test_basilisk.py

test-long: export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST
test-long: export OPENBLAS_NUM_THREADS := 1
test-long: install/.built
	$(STEP) "long tests"
	@. ./install/setup.sh && pytest -n 2 --dist worksteal -m long

mutants: export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST
mutants: install/.built
	@. ./install/setup.sh && python3 scripts/mutants.py $(ARGS)

fuzz: install/.built
	@. ./install/setup.sh && export OPENBLAS_NUM_THREADS=1 && python3 scripts/fuzz_files.py $(ARGS)

lint: install/.built
	$(STEP) "ruff"
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	$(STEP) "mypy"
	@$(BIN)/mypy
	$(STEP) "import directions"
	@$(BIN)/lint-imports --no-logo
	$(STEP) "budgets of lines"
	@$(BIN)/python scripts/check_budgets.py

# Sphinx has a virtual environment of its own, which finds the project's packages behind its own.
DOCS := $(VENV)/docs/bin

docs: install/.built $(VENV)/docs/.installed
	$(STEP) "site"
	@. ./install/setup.sh && $(DOCS)/python -m sphinx -W --keep-going -q -d build/doctrees docs build/docs $(ARGS)
	@echo "   build/docs/index.html"

$(VENV)/docs/.installed: docs/requirements.txt $(VENV)/.installed
	@"$(BIN)/python" -m venv --clear "$(VENV)/docs"
	@$(DOCS)/python -m pip --quiet --disable-pip-version-check --no-input install --no-deps -r docs/requirements.txt
	@"$(BIN)/python" -c 'import sysconfig; print("import site; site.addsitedir(%r)" % sysconfig.get_path("purelib"))' \
	  > "$$($(DOCS)/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/project.pth"
	@touch $@

# Measurements: what they write is committed. `make benchmark-model-errors` runs scripts/benchmark_model_errors.py.
paper-table: install/.built
	@. ./install/setup.sh && OPENBLAS_NUM_THREADS=1 python3 scripts/paper_table.py --output docs $(ARGS)

benchmark-%: install/.built
	@. ./install/setup.sh && OPENBLAS_NUM_THREADS=1 python3 scripts/benchmark_$(subst -,_,$*).py --output docs $(ARGS)

clean:
	rm -rf .venv build install log .hypothesis .import_linter_cache .mypy_cache .pytest_cache .ruff_cache
	find mbaid_ros scripts test -name __pycache__ -prune -exec rm -rf {} +

# A virtual environment and a colcon build know the folder they were made in: after a move, both are made anew.
MOVED := $(filter-out $(CURDIR),$(file <$(VENV)/.installed))

$(VENV)/.installed: requirements.txt constraints.txt $(if $(MOVED),FORCE)
	@start=$$(date +%s); \
	$(if $(MOVED),rm -rf .venv build install log;) \
	if ! "$(BIN)/python" -c "" 2>/dev/null; then \
	  python=$$(scripts/find_python.sh $(PYTHON)) || exit 1; \
	  echo "== virtual environment: $$("$$python" --version), $$python"; \
	  "$$python" -m venv --clear .venv || exit 1; \
	fi; \
	echo "== packages of requirements.txt (1.2 GB on disk; a minute or two)"; \
	pip="$(BIN)/python -m pip --quiet --disable-pip-version-check --no-input install --no-compile -c constraints.txt"; \
	$(if $(HASHES),pip="$(BIN)/python -m pip --quiet --disable-pip-version-check --no-input install --no-compile --require-hashes"; \
	grep '^setuptools==' requirements.lock >.venv/setuptools.lock && $$pip -r .venv/setuptools.lock \
	  && $$pip --no-build-isolation --use-pep517 -r requirements.lock || exit 1;, \
	$$pip setuptools && $$pip --no-build-isolation --use-pep517 -r requirements.txt || exit 1;) \
	echo "   $$(($$(date +%s) - start)) s"
	@printf '%s' "$(CURDIR)" >$@

# colcon installs links to the sources: it has work to do only when a message, a recipe or the list of files changes.
install/.files: FORCE
	@mkdir -p install; ls config/* msg_defs/msg/* >$@.new 2>/dev/null; \
	if cmp -s $@.new $@; then rm $@.new; else mv $@.new $@; fi

install/.built: $(VENV)/.installed install/.files package.xml setup.py setup.cfg colcon_defaults.yaml \
		scripts/link_workspace.py msg_defs/package.xml msg_defs/CMakeLists.txt $(wildcard msg_defs/*/* wheel_msgs/*/* wheel_msgs/*/msg/*)
	@start=$$(date +%s); \
	echo "== colcon build of mbaid_msgs, tf2_msgs and mbaid_ros"; \
	rm -rf build/mbaid_ros install/mbaid_ros; \
	"$(BIN)/python" scripts/link_workspace.py && . "$(VENV)/local_setup.sh" && \
	colcon --log-level error build --event-handlers console_start_end- status- summary- desktop_notification- || exit 1; \
	. install/setup.sh && "$(BIN)/python" -m compileall -q mbaid_ros && "$(BIN)/python" -c 'import mbaid_ros.replay.replay'; \
	echo "   $$(($$(date +%s) - start)) s"
	@touch $@

FORCE:
