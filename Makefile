# make env | demo | test | test-slow | bench | bench-report | check | docs | clean; what they do stands in README.md.
# Every step leaves a stamp in .venv/.stamps, so nothing is done twice; of what is installed it tells when that began: a
# file that is saved meanwhile is newer.

VENV := .venv
STAMPS := $(VENV)/.stamps
RUN := $(VENV)/bin
PACKAGES := $(shell sed -n '/^PACKAGES = (/,/^)/s/^ *"\(.*\)",$$/\1/p' setup.py)
SOURCES := $(sort $(shell find $(PACKAGES) -name '*.py' -o -name '*.npz') \
	$(wildcard launch/*.launch.py config/*.* config/cameras/*.yaml) setup.py setup.cfg package.xml resource/sphere_nav)

# Neither a sourced ROS 2 installation nor another environment of wheels may leak into this one; and what is compiled is
# kept: a process of tests would spend eight seconds on it each time.
unexport PYTHONPATH LD_LIBRARY_PATH AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH VIRTUAL_ENV
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE PYTHONDONTWRITEBYTECODE

.PHONY: env ready demo test test-slow bench bench-report check docs clean FORCE
.DELETE_ON_ERROR:

# The interface packages and the kernels at the same time; a plain `make` would do one after the other.
env: $(STAMPS)/wheels
	@$(MAKE) --no-print-directory -j3 ready

ready: $(STAMPS)/tf2_msgs $(STAMPS)/msg_defs $(STAMPS)/kernels

demo: env
	$(RUN)/sphere_nav demo $(ARGS)

# The rings of tests are told in test/rings.py; what `check` runs is left out. A worker a core, and one more where
# tests wait for processes that they start; of many cores four.
TEST := $(RUN)/pytest --maxprocesses 4 --dist worksteal

test: env $(STAMPS)/test_wheels
	$(TEST) -n auto -m "not slow and not dds" $(ARGS)

test-slow: env $(STAMPS)/test_wheels
	$(TEST) -n $$(($$(nproc) + 1)) -m "slow or dds" --ignore test/architecture --ignore test/config $(ARGS)

# all in quick size, or what ARGS names: ARGS="drive missions --size full"
bench: env
	$(RUN)/python -m benchmarks $(or $(ARGS),all --size quick)

# docs/results.md from out/bench/*.json, which `bench` leaves
bench-report: $(STAMPS)/wheels
	$(RUN)/python -m benchmarks.results

check: env $(STAMPS)/test_wheels
	$(RUN)/ruff check .
	$(RUN)/mypy $(PACKAGES) benchmarks
	$(RUN)/pytest -q -n 0 test/architecture test/config
	PATH="$(CURDIR)/$(RUN):$$PATH" scripts/check_colcon.sh
	$(RUN)/python scripts/sizes.py

# config/*.yaml and docs/parameters.md from the parameters classes; out/api/index.html from the docstrings of the library
docs: env $(STAMPS)/test_wheels
	$(RUN)/python docs/generate.py
	$(RUN)/pdoc --docformat google --no-show-source --output-directory out/api \
		sphere_nav_tools.library sphere_nav.geometry sphere_nav.spheres.sphere

clean:
	rm -rf $(VENV) build *.egg-info

# An environment cannot be moved: one that was made elsewhere is made anew.
ifneq ($(wildcard $(STAMPS)/python),)
ifneq ($(shell cat $(STAMPS)/python),$(CURDIR))
$(shell rm -rf $(VENV))
endif
endif

$(STAMPS)/python:
	@echo "env: making $(VENV)"
	@rm -rf $(VENV)
	@python=$$(scripts/system_tools.sh) && "$$python" -m venv $(VENV)
	@mkdir -p $(STAMPS) && echo "$(CURDIR)" > $@

$(STAMPS)/wheels: requirements.txt constraints.txt scripts/install_wheels.py | $(STAMPS)/python
	@echo "env: installing the wheels of requirements.txt (300 MB to download)"
	@$(RUN)/python scripts/install_wheels.py -r requirements.txt -c constraints.txt pip
	@touch $@

$(STAMPS)/test_wheels: requirements-test.txt constraints.txt | $(STAMPS)/wheels
	@echo "env: installing the wheels of requirements-test.txt"
	@$(RUN)/python scripts/install_wheels.py -r requirements-test.txt -c constraints.txt
	@touch $@

$(STAMPS)/tf2_msgs: $(wildcard cmake/tf2_msgs/* cmake/tf2_msgs/msg/*) $(STAMPS)/wheels cmake/wheel_includes.cmake
	@touch $@.begun
	@echo "env: building tf2_msgs"
	@scripts/build_interfaces.sh cmake/tf2_msgs $(VENV)
	@mv $@.begun $@

$(STAMPS)/msg_defs: $(wildcard msg_defs/* msg_defs/msg/* msg_defs/srv/* msg_defs/action/*) $(STAMPS)/wheels cmake/wheel_includes.cmake
	@touch $@.begun
	@echo "env: building sphere_nav_msgs"
	@scripts/build_interfaces.sh msg_defs $(VENV)
	@mv $@.begun $@

$(STAMPS)/sources: FORCE | $(STAMPS)/wheels
	@echo "$(SOURCES)" | cmp -s - $@ || echo "$(SOURCES)" > $@

$(STAMPS)/sphere_nav: $(SOURCES) $(STAMPS)/sources $(STAMPS)/wheels scripts/install_package.sh
	@touch $@.begun
	@echo "env: installing sphere_nav"
	@scripts/install_package.sh $(VENV)
	@mv $@.begun $@

$(STAMPS)/kernels: $(filter %/kernels.py %/warm_up.py,$(SOURCES)) scripts/compile_kernels.sh | $(STAMPS)/sphere_nav
	@touch $@.begun
	@echo "env: compiling the kernels (a minute where they are not in the cache)"
	@scripts/compile_kernels.sh $(VENV)
	@mv $@.begun $@

# --- what CI and a night prove besides: the real ros2, the oldest libraries, a newer Python
.PHONY: ros2 test-ros2 test-oldest test-newer test-wheel
ROS2_SOURCES ?= ../shared/ros2cli
OLDEST := build/oldest
NEWER := build/newer
EMPTY := $(CURDIR)/build/empty

# All tests that need a `ros2`, with one that is made of its sources beside the environment: `make ros2`.
test-ros2: env $(STAMPS)/test_wheels ros2
	ROS2=$(CURDIR)/build/ros2/ros2 $(RUN)/pytest -n0 -ra test/installation/test_ros2_tools.py \
		test/sphere_nav_tools/cli/test_keystore.py $(ARGS)

ros2: env
	$(ROS2_SOURCES)/install.sh $(VENV) build/ros2

# NumPy, SciPy, Numba and OpenCV as in Ubuntu 24.04, in an environment of their own.
test-oldest:
	$(MAKE) VENV=$(OLDEST) $(addprefix $(OLDEST)/.stamps/,test_wheels tf2_msgs msg_defs sphere_nav)
	$(OLDEST)/bin/python scripts/install_wheels.py -r requirements-oldest.txt
	scripts/compile_kernels.sh $(OLDEST)
	$(OLDEST)/bin/pytest -n auto --maxprocesses 4 --dist worksteal $(ARGS)

# With the Python that PYTHON names, or the newest that uv finds or brings.
test-newer: $(STAMPS)/wheels
	python=$${PYTHON:-$$($(RUN)/uv python find '>=3.12' 2>/dev/null || \
		{ $(RUN)/uv python install 3.13 >&2 && $(RUN)/uv python find 3.13; })} && \
		PYTHON=$$python $(MAKE) VENV=$(NEWER) test

# What `pip install .` gives in an empty environment: the demo, from another folder.
test-wheel: | $(STAMPS)/python
	rm -rf $(EMPTY) && $(RUN)/python -m venv $(EMPTY) && $(EMPTY)/bin/pip install -q .
	cd $(EMPTY) && env -i HOME=$(EMPTY) PATH=/usr/bin:/bin bin/sphere_nav demo --path straight
