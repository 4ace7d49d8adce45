# `make` lists the targets.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
MISSION ?= missions/first_flight.yaml
TIMES ?= 1
FLIGHTS ?= 100

.DEFAULT_GOAL := help
unexport PYTHONDONTWRITEBYTECODE  # the tests start many processes
.PHONY: help fly test check lint kernels generated pictures looked-at docs extended air bench campaign around faults link-cuts mocap onboard preflight imported guardian safe-defaults killed-studies mutants scenarios fuzz soak lowest clean

help:  ## list the targets
	@grep -hE '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*##/\t/' | expand -t 12

$(VENV)/.ready: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	touch $@

$(VENV)/.flight: pyproject.toml  # what a flight needs, without the development tools
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --disable-pip-version-check --editable .
	touch $@

fly: $(if $(wildcard $(VENV)/.ready),$(VENV)/.ready,$(VENV)/.flight)  ## set up and fly MISSION (missions/first_flight.yaml)
	$(BIN)/star-run $(MISSION)

test: $(VENV)/.ready  ## set up and run every check and the default tests
	$(MAKE) --no-print-directory check

check: $(VENV)/.ready  ## style, types, layers, tests
	$(MAKE) --no-print-directory --jobs=2 lint kernels
	$(BIN)/python -m pytest -q -n $$(( $$(nproc) * 2 ))  # more than processors: some tests wait

lint: $(VENV)/.ready  ## style, types, layers
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

kernels: $(VENV)/.ready  # compiles most of them for all processes of the tests
	for mission in first_flight around search; do \
	$(BIN)/star-run missions/$$mission.yaml --no-record 2>/dev/null; done

generated: $(VENV)/.ready  ## write the files that are made from the code: schemas for editors, pages, examples
	$(BIN)/star schema --out missions/mission.schema.json
	$(BIN)/star schema steps --out missions/steps.schema.json
	$(BIN)/star errors > docs/errors.md
	$(BIN)/python docs/site/committed.py

pictures: $(VENV)/.ready  ## make the pictures of README and docs/ anew (needs Chromium); minutes
	$(BIN)/python docs/site/pictures.py

looked-at: docs  ## make pictures of every page and of the terminal in build/looked-at, to be looked at (needs Chromium, tmux, pdftoppm); minutes
	$(BIN)/python docs/site/looked_at.py

docs: $(VENV)/.ready  ## build the documentation into build/docs; warnings are errors
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
	@echo "open build/docs/index.html; with search: $(BIN)/python -m http.server --bind 127.0.0.1 --directory build/docs"

extended: $(VENV)/.ready  ## flights that judge accuracy or safety, other long tests, every benchmark and campaign in a small size
	$(BIN)/python -m pytest -q -n $$(( $$(nproc) * 2 )) -m "extended and not campaign"

air: $(VENV)/.ready  ## the flights over the radio's protocol that `make check` leaves out
	$(BIN)/python -m pytest -q -m campaign tests/end_to_end/test_over_the_air.py tests/end_to_end/test_motion_capture.py

bench: $(VENV)/.ready  ## print the figures of benchmarks/ (installs their peers)
	$(BIN)/python -m pip install --quiet --no-deps pupil-apriltags drone-models \
	casadi array-api-compat array-api-extra
	for topic in startup demo sim tick tick_cost drag orca planner camera detector mosaic disturbances landmarks fleet aideck radio; do $(BIN)/python benchmarks/$$topic.py; done

campaign: $(VENV)/.ready  ## the studies of docs/results.md and the tests that take long
	$(BIN)/python -m pytest -q -n auto -m "hypothesis and not campaign" --hypothesis-profile=campaign
	$(BIN)/python -m pytest -q -m campaign
	for study in drift paper-table-1 localisation; do $(BIN)/star ablate missions/studies/$$study.yaml; done
	for topic in covariance search relief coverage; do $(BIN)/python -m tests.campaign.$$topic; done
	for project in cflib crazyswarm2; do $(BIN)/python -m tests.campaign.$${project}_examples; done
	$(BIN)/python benchmarks/downwash.py

around: $(VENV)/.ready  ## the table of around.yaml in docs/methods.md: contacts with obstacles, heights over them; long
	$(BIN)/python -m tests.campaign.around

mocap: $(VENV)/.ready  ## the tables of docs/mocap.md: flights by motion capture; long
	$(BIN)/python -m tests.campaign.mocap

onboard: $(VENV)/.ready  ## the table of docs/lighthouse.md: flights by Lighthouse, Loco and received poses; long
	$(BIN)/python -m tests.campaign.onboard

preflight: $(VENV)/.ready  ## injected faults that `star preflight` names, and its false alarms (docs/hardware.md); long
	$(BIN)/python -m tests.campaign.preflight

imported: $(VENV)/.ready  ## flights of imported files of the original STAR: drawn ones, or those of FOLDER; long
	$(BIN)/python -m tests.campaign.imported $(FOLDER)

guardian: $(VENV)/.ready  ## the table of docs/guardian.md: flights whose program or guardian dies; long
	$(BIN)/python -m tests.campaign.guardian
	$(BIN)/python -m tests.campaign.guardian --cost

faults: $(VENV)/.ready  ## the fault matrix of docs/reliability.md; long
	$(BIN)/python -m tests.campaign.faults --page docs/reliability.md

link-cuts: $(VENV)/.ready  ## the table of cut links in docs/reliability.md; long; FLIGHTS=10 flies fewer of each
	$(BIN)/python -m tests.campaign.link_cuts --flights $(FLIGHTS)

fuzz: $(VENV)/.ready  ## spoiled inputs of every kind (docs/fuzzing.md); long; TIMES=0.1 tries fewer, SKIP=flights leaves one out
	$(BIN)/python -m tests.fuzz --times $(TIMES) $(addprefix --skip ,$(SKIP))

soak: $(VENV)/.ready  ## 30 drones over the protocol for 10 minutes: ticks, memory, files, threads; exit 1 if a bound is broken
	$(BIN)/python benchmarks/soak.py

safe-defaults: $(VENV)/.ready  ## the table of safe defaults in docs/reliability.md; long
	$(BIN)/python -m tests.campaign.safe_defaults

killed-studies: $(VENV)/.ready  ## a study of 1000 runs killed five times, compared with an uninterrupted one (docs/studies.md)
	$(BIN)/python -m tests.campaign.killed_studies

mutants: $(VENV)/.ready  ## plant small mistakes, and print which of them the tests notice
	$(BIN)/python -m tests.campaign.mutants

scenarios: $(VENV)/.ready  ## the table of scenarios in docs/benchmarks.md; long
	$(BIN)/star bench --seeds 30 --out runs/scenarios

lowest:  ## the tests with every dependency at its lower bound
	$(PYTHON) -m venv --clear $(VENV)-lowest
	$(VENV)-lowest/bin/python -m pip install --quiet --upgrade pip
	$(VENV)-lowest/bin/python -c 'import tomllib; \
	print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["dependencies"], sep="\n")' \
	| sed 's/>=/==/' > $(VENV)-lowest/constraints.txt
	$(VENV)-lowest/bin/python -m pip install --quiet --constraint $(VENV)-lowest/constraints.txt \
	--editable '.[dev]'
	$(VENV)-lowest/bin/python -m pytest -q -n auto -m "not campaign"

clean:  ## remove what the other targets made
	rm -rf $(VENV) $(VENV)-lowest build dist .pytest_cache .mypy_cache .ruff_cache .import_linter_cache
