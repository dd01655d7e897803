# Every target makes the environment that it needs, in this folder only. `make help` lists them.

PYTHON ?= python3
ROS_DISTRO ?= kilted
ARGS ?=
WORKERS ?= 3

PYTHON_VERSION := $(shell $(PYTHON) -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null)
METADATA := package.xml setup.py setup.cfg pyproject.toml
, := ,
RUN := .venv
TEST := .venv-$(ROS_DISTRO)$(if $(COMPILE),-compiled)
RUN_READY := $(RUN)/ready-$(PYTHON_VERSION)
TEST_READY := $(TEST)/ready-$(PYTHON_VERSION)
# A test that hangs says where, after so many seconds, and fails; all others go on. Here, because
# the pytest of Ubuntu, which colcon takes, does not know it.
HANGING := -o faulthandler_timeout=600 -o faulthandler_exit_on_timeout=true
# With COMPILE=1 the tests run beside the installed package, not the sources.
TREE := $(TEST)/checkout
SOURCES := $(shell find rovid_core rovid_ros -name '*.py')

# The environments stand alone, whatever ROS installation this shell has sourced.
unexport PYTHONPATH AMENT_PREFIX_PATH LD_LIBRARY_PATH _ROS_WHEELS_BOOTSTRAP_COMPLETE
unexport RMW_IMPLEMENTATION ROVID_COMPILE
# Without it every worker and every process that a test starts compiles all modules again.
unexport PYTHONDONTWRITEBYTECODE
# Each worker of the tests has a core; threads of the linear algebra would only wait for one.
export OPENBLAS_NUM_THREADS = 1

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help demo test pytest lint figures bench picture browser clean

help:
	@echo 'make demo   simulate a vehicle and identify it; needs no ROS'
	@echo 'make test   linters, types and all tests but the long ones, on real ROS 2 from PyPI'
	@echo '            ROS_DISTRO=kilted|jazzy, ARGS="-k replay" goes to pytest, WORKERS=3 at once'
	@echo '            COMPILE=1: all tests, the long ones too, on what mypyc has compiled'
	@echo 'make lint   linters and types only'
	@echo 'make figures  every table of docs/measurements/, in about 90 minutes; ARGS="accuracy speed.step"'
	@echo 'make bench  those of docs/measurements/speed.md alone'
	@echo 'make picture  docs/report.png, the report of two simulated trials; needs Chromium'
	@echo 'make browser  Debian Chromium, for the tests that open the report (needs root)'
	@echo 'make clean  remove what the other targets made'
	@echo 'All take PYTHON=..., the interpreter to use (3.10 or newer; now: $(PYTHON))'

demo: $(RUN_READY)
	$(RUN)/bin/python -m rovid_ros.commands.demo

ifeq ($(COMPILE),)
test: $(TEST_READY)
	@$(MAKE) --no-print-directory -j2 lint pytest

pytest: $(TEST_READY)
	$(TEST)/bin/python -m pytest -n $(WORKERS) --dist worksteal $(HANGING) $(ARGS)
else
test: $(TEST)/compiled
	rm -rf $(TREE)
	mkdir $(TREE)
	cp -r $(filter-out build rovid_core rovid_ros %.egg-info,$(wildcard *)) $(TREE)
	ln -s $(addprefix ../lib/python$(PYTHON_VERSION)/site-packages/,rovid_core rovid_ros) $(TREE)
	cd $(TREE) && ROVID_DATA=$${ROVID_DATA:-$(CURDIR)/../shared/data} \
		../bin/python -m pytest -m '' -n $(WORKERS) --dist worksteal $(HANGING) $(ARGS)
endif

$(TEST)/compiled: $(TEST_READY) $(SOURCES)
	ROVID_COMPILE=1 $(TEST)/bin/python -m pip install --quiet --disable-pip-version-check \
		--no-deps --force-reinstall .
	@touch '$@'

# Types against kilted only: in jazzy most of rclpy has no annotations.
lint: $(TEST_READY)
	$(TEST)/bin/ruff check .
ifeq ($(ROS_DISTRO),kilted)
	$(TEST)/bin/mypy
endif

figures: $(TEST_READY)
	$(TEST)/bin/python -m pip install --quiet --disable-pip-version-check -r benchmarks/requirements.txt
	$(TEST)/bin/python -m benchmarks.figures $(ARGS)

bench:
	@$(MAKE) figures ARGS='$(or $(ARGS),speed)'

picture: $(TEST_READY)
	$(TEST)/bin/python -m benchmarks.report_picture $(ARGS)

browser:
	@if command -v chromium || command -v chromium-browser || command -v google-chrome; then :; \
	elif [ "$$(id -u)" = 0 ] && apt-get -qq update && apt-get -qq install -y chromium; then :; \
	else echo 'no Chromium: the tests that open the report in a browser are skipped'; fi

clean:
	rm -rf .venv .venv-* build *.egg-info .hypothesis .mypy_cache .pytest_cache .ruff_cache
	find . -name __pycache__ -prune -exec rm -rf {} +

# $(call environment,FOLDER,EXTRAS): made afresh, with this package from its sources.
define environment
@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' 2>/dev/null || \
	{ echo 'rovid needs Python 3.10 or newer, $(PYTHON) is $(or $(PYTHON_VERSION),not there)' \
	'(choose another with PYTHON=...)' >&2; exit 1; }
$(PYTHON) -m venv --clear $(1)
$(1)/bin/python -m pip install --quiet --disable-pip-version-check --editable '.$(2)'
endef

$(RUN_READY): $(METADATA)
	$(call environment,$(RUN))
	@touch '$@'

$(TEST_READY): $(METADATA)
	@case '$(ROS_DISTRO)' in kilted|jazzy) ;; \
	*) echo 'ROS_DISTRO=$(ROS_DISTRO): takes kilted or jazzy' >&2; exit 1 ;; esac
	$(call environment,$(TEST),[$(ROS_DISTRO)$(,)test])
	@touch '$@'
