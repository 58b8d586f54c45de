# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

# Set-up, demonstration, tests. `make` or `make help` lists the targets.

# The Python to build the virtual environment with, and where to put it.
PYTHON ?= python3
VENV ?= .venv
# The ROS 2 distribution whose wheels are installed: jazzy or kilted.
ROS ?= jazzy
# Everything optional: what a laptop shows must not depend on what was chosen at set-up.
EXTRAS = ros-$(ROS),analysis,bench,serial,can,zenoh,audio,mujoco,mesh
# Words to add to a command, as in: make test ARGS="-k filters"
ARGS ?=

SHELL := /bin/sh
.SHELLFLAGS := -ec
.ONESHELL:
.DELETE_ON_ERROR:
.DEFAULT_GOAL := help

BIN := $(VENV)/bin
RUNTIME := $(VENV)/.runtime
DEV := $(VENV)/.dev
DOCS := $(VENV)/.docs
TICK := $(BIN)/python -c 'from haptic_accel.core.tick import TICK; print(TICK)'
# Says what the environment is and where; absent while packages are being installed.
WHOLE := $(VENV)/.whole

# The wheels bring a ROS 2 of their own. Another that was sourced, or the environment of a Python
# that already runs on such wheels, must not be mixed in.
ifneq ($(AMENT_PREFIX_PATH)$(_ROS_WHEELS_BOOTSTRAP_COMPLETE),)
unexport LD_LIBRARY_PATH
endif
unexport AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH PYTHONHOME PYTHONPATH
unexport RMW_IMPLEMENTATION ROS_DISTRO ROS_PYTHON_VERSION ROS_VERSION
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE
# Nodes and tests would be compiled anew in each of the many processes that the tests start.
unexport PYTHONDONTWRITEBYTECODE
export PIP_DISABLE_PIP_VERSION_CHECK := 1

# If not told which Python to take, look further than python3.
ifeq ($(origin PYTHON),file)
CANDIDATES := $(PYTHON) python3.13 python3.12 python3.11 python3.10
else
CANDIDATES := $(PYTHON)
endif

# Prints what the Python is, and fails where there are no ROS 2 wheels for it.
define PROBE
import platform, sys, sysconfig
version, target = sys.version_info[:2], sysconfig.get_platform()
libc = platform.libc_ver()[0]
print("%s %d.%d on %s %s" % ((platform.python_implementation(),) + version + (target, libc)))
supported = (3, 10) <= version <= (3, 13) and (target, libc) == ("linux-x86_64", "glibc")
sys.exit(not (supported and platform.python_implementation() == "CPython"))
endef
export PROBE

# Runs pip, and prints now and then what it is doing: it takes a minute, or several on a slow line.
define INSTALL
import subprocess, sys, time
pip = [sys.executable, "-m", "pip", "install", "--progress-bar", "off", "--editable", sys.argv[1]]
process = subprocess.Popen(pip, stdout=subprocess.PIPE, text=True, errors="replace")
told = time.monotonic()
for line in process.stdout:
    is_step = line.lstrip().startswith(("Collecting", "Downloading", "Building", "Installing"))
    if is_step and time.monotonic() - told >= float(sys.argv[2]):
        print(" ", line.strip()[:70], flush=True)
        told = time.monotonic()
sys.exit(process.wait())
endef
export INSTALL

# Fails if tests noticed fewer than 90 % of the changes: some cannot be noticed, as < for <=.
define KILLED
import json, sys
found = json.load(open("mutants/mutmut-cicd-stats.json"))
killed = found["killed"] + found["timeout"]
print("Tests noticed %d of %d changes" % (killed, found["total"]))
sys.exit(killed < 0.9 * found["total"])
endef
export KILLED

# pip, so that a stop in its middle leaves no environment that passes for a whole one.
define pip_install
rm -f $(WHOLE)
trap 'exit 130' HUP INT TERM
failed=
$(BIN)/python -c "$$INSTALL" '.[$(1)]' 5 || failed=yes
echo "$(ROS) $$(pwd -P)" > $(WHOLE)
[ -z "$$failed" ] || { echo "error: pip could not install haptic_accel[$(1)], see above" >&2; exit 1; }
endef

.PHONY: help
help: ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-8s %s\n", $$1, $$2 }' Makefile

.PHONY: venv
venv: $(RUNTIME) ## create .venv with everything that runs, .venv/bin/haptic-accel among it

.PHONY: touch
touch: $(RUNTIME) ## touch a surface on a page in the browser; Ctrl-C ends it
	@$(BIN)/haptic-accel touch $(ARGS)

.PHONY: demo
demo: $(RUNTIME) ## run the paper's experiment through the live ROS 2 graph
	@$(BIN)/haptic-accel experiment $(ARGS)

.PHONY: test
test: $(DEV) ## run the test suite: what needs no graph on all cores, then one graph at a time
	@failed= found=
	part() {
	    status=0
	    "$$@" --untouched-parts="$${untouched%%:*}" $(SLOW) $(ARGS) || status=$$?
	    # 5: no test was chosen, which is right for some of the parts.
	    case $$status in 0) found=yes ;; 5) ;; *) failed=yes ;; esac
	}
	# A section may have been edited since the installation.
	$(BIN)/python -W ignore setup.py -q build_ext --inplace
	tick=$$($(TICK))
	echo "What runs in every sample: $$tick"
	untouched=$(if $(SLOW)$(findstring test/,$(ARGS)),,$$($(BIN)/python test/support/untouched_parts.py))
	# One process more than there are cores, as tests wait for others a quarter of the time.
	together="-n $$(($$(nproc) + 1)) --dist worksteal"
	part $(BIN)/python -m pytest $$together -m 'not live'
	[ "$$tick" != compiled ] || part env HAPTIC_ACCEL_PLAIN=1 \
	    $(BIN)/python -m pytest $$together -m '(safety or plain) and not live'
	part $(BIN)/python -m pytest -m live
	[ -z "$$untouched" ] || echo "Not all tests ran of these parts (make test-all: all): $$untouched"
	[ -z "$$failed" ] && [ -n "$$found" ]

.PHONY: test-all
test-all: SLOW = --slow
test-all: test ## run the slow tests as well, and those of all kits

.PHONY: mutants
mutants: $(DEV) ## change what keeps a hand safe, operator by operator: tests must notice
	@$(BIN)/pip install -q 'mutmut>=3.8,<4'
	rm -rf mutants
	HAPTIC_ACCEL_PLAIN=1 $(BIN)/mutmut run $(ARGS)
	$(BIN)/mutmut results
	$(BIN)/mutmut export-cicd-stats
	$(BIN)/python -c "$$KILLED"

.PHONY: lint
lint: $(DEV) ## check style (ruff) and types (mypy)
	@failed=
	$(BIN)/ruff check . || failed=yes
	$(BIN)/ruff format --check . || failed=yes
	$(BIN)/mypy || failed=yes
	[ -z "$$failed" ]

.PHONY: docs
docs: $(DOCS) ## build the documentation site in build/docs
	@$(BIN)/sphinx-build -q -E -W --keep-going -c docs . build/docs
	echo build/docs/index.html

.PHONY: release
release: $(DEV) ## build source distribution and wheel in dist, and check them
	@rm -rf dist
	$(BIN)/python -m build --outdir dist .
	$(BIN)/python -m twine check --strict dist/*

.PHONY: clean
clean: ## remove what make, colcon and the tools wrote; results/ is kept
	@rm -rf $(VENV) build dist install log mutants *.egg-info .benchmarks .hypothesis
	rm -rf .mypy_cache .pytest_cache .ruff_cache
	find benchmarks docs haptic_accel launch test -name __pycache__ -prune -exec rm -rf {} +

# An environment that is not whole, was moved, has another ROS 2 or lost its Python is built anew.
ifneq ($(shell [ -x $(BIN)/python3 ] && cat $(WHOLE) 2>/dev/null),$(ROS) $(CURDIR))
.PHONY: $(RUNTIME)
endif

$(RUNTIME): Makefile package.xml pyproject.toml setup.cfg setup.py
	@if [ "$$(cat $(WHOLE) 2>&1)" != "$(ROS) $$(pwd -P)" ] || ! [ -x $(BIN)/python3 ]; then
	    python= found=
	    for candidate in $(CANDIDATES); do
	        if what=$$("$$candidate" -c "$$PROBE" 2>/dev/null); then
	            python=$$candidate
	            break
	        fi
	        [ -n "$$found" ] || found="$$candidate $${what:+is }$${what:-cannot be run}"
	    done
	    if [ -z "$$python" ]; then
	        echo "error: needs CPython 3.10 to 3.13 on x86-64 Linux with glibc: $$found" \
	            "(name another with PYTHON=)" >&2
	        exit 1
	    fi
	    if ! "$$python" -c 'import ensurepip, venv' 2>/dev/null; then
	        package=$$("$$python" -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])')
	        if [ "$$(id -u)" != 0 ] || ! command -v apt-get >/dev/null; then
	            echo "error: $$python cannot create virtual environments yet:" \
	                "run  sudo apt-get install $$package" >&2
	            exit 1
	        fi
	        echo "Installing $$package"
	        export DEBIAN_FRONTEND=noninteractive
	        apt-get update -qq && apt-get install -qq --no-install-recommends "$$package" \
	            </dev/null >/dev/null || { echo "error: could not install $$package" >&2; exit 1; }
	    fi
	    echo "Creating $(VENV) with $$("$$python" -c "$$PROBE")"
	    "$$python" -m venv --clear $(VENV)
	    # Its packages are no part of a colcon workspace.
	    touch $(VENV)/COLCON_IGNORE
	fi
	echo "Installing haptic_accel and ROS 2 $(ROS) into $(VENV): 0.8 GB, about a minute"
	$(call pip_install,$(EXTRAS))
	echo "What runs in every sample: $$($(TICK))"
	touch $@

$(DEV): $(RUNTIME)
	@echo "Installing the tools for tests and checks into $(VENV)"
	$(call pip_install,dev)
	touch $@

$(DOCS): $(RUNTIME)
	@echo "Installing the tools for the documentation into $(VENV)"
	$(call pip_install,docs)
	touch $@
