"""Command line of ``star bench``: writes scenarios, flies them, and writes the table."""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from star_bench.files import (
    AVOIDER,
    FACTORS,
    MEASURES,
    POSITIONS,
    SETTING,
    SETTINGS,
    SPEED,
    STUDY,
    WORLDS,
    Campaign,
    write,
)
from star_bench.scenarios import CATALOGUE, MAX_AGENTS, MIN_AGENTS, Case, checked_options, numbers
from star_bench.table import Key, Metrics, as_csv, as_markdown, as_table, metrics, rows
from star_core import InputError, PluginError, Registry
from star_core.commands import output_folder, positive_integer, write_report, writing
from star_core.toolkit import Progress, StudyFlight, StudyResults, print_table, suggestion

FLOWN: Final = "flown"  # folder of the study's results
ABOUT: Final = "study.json"
SEEDS: Final = 5


def run(options: argparse.Namespace, registry: Registry) -> int:
    """Fly a campaign and return the exit status: 0 when all runs are flown, whatever their outcome.

    Raises:
        InputError: A flag has an invalid value, the folder cannot be written, or no plugin flies
            studies.
    """
    campaign = Campaign(
        cases=tuple(_cases(options)),
        avoiders=levels(options.avoiders, registry),
        settings=_settings(options),
    )
    folder = output_folder(options.out, "bench", STUDY)
    with writing(folder):
        study = write(campaign, folder)
        if options.write_only:
            sys.stdout.write(f"{len(campaign.cases)} missions and their study: {study}\n")
            return 0
        sys.stderr.write(f"star: {campaign.runs} flights; all are checked before the first\n")
        flown = _fly(study, folder / FLOWN, options.workers, registry)
        with Progress("tabulating"):
            groups = rows(_metrics(flown, campaign))
        table = as_markdown(groups)
        (folder / "bench.csv").write_text(as_csv(groups), encoding="utf-8")
        (folder / "bench.md").write_text(table, encoding="utf-8")
        titled = StudyResults(tuple(_titled(flown, campaign)))
        (folder / "results.csv").write_text(titled.as_csv(FACTORS, MEASURES), encoding="utf-8")
        _write_versions(folder)
    line, _ = write_report(folder, registry)
    if sys.stdout.isatty():
        print_table(as_table(groups))
    else:
        sys.stdout.write(table)
    sys.stdout.write(f"\nresults: {folder}\n{line}\n")
    return 1 if flown.interrupted else 0


def _write_versions(folder: Path) -> None:
    """Write, for the report, with which command and versions the campaign was flown."""
    with suppress(FileNotFoundError):  # whatever flies studies need not write it
        about = json.loads((folder / FLOWN / ABOUT).read_text(encoding="utf-8"))
        versions = {name: value for name, value in about.items() if name != "study"}
        (folder / ABOUT).write_text(json.dumps(versions, indent=2), encoding="utf-8")


def configure(line: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    line.epilog = (
        "Options of an avoider or a scenario follow its name:"
        " orca=radius:0.25,horizon:2 or corridor=width:2."
    )
    line.add_argument(
        "--scenarios", nargs="+", default=[], metavar="NAME", help=f"{', '.join(CATALOGUE)} (all)"
    )
    line.add_argument("--avoiders", nargs="+", default=[], metavar="NAME", help="(all installed)")
    line.add_argument(
        "--agents",
        nargs="+",
        type=int,
        metavar="N",
        help=f"numbers of agents, {MIN_AGENTS} to {MAX_AGENTS} (each scenario's own)",
    )
    line.add_argument(
        "--seeds",
        type=positive_integer,
        default=SEEDS,
        metavar="N",
        help="seeds 0 to N-1: %(default)s",
    )
    line.add_argument(
        "--world",
        nargs="+",
        choices=WORLDS,
        default=["ideal"],
        help="errors of the simulator: none, or those of missions without options (ideal)",
    )
    line.add_argument(
        "--positions",
        nargs="+",
        choices=POSITIONS,
        default=["exact", "bounded"],
        help="exact, measured with 3 cm of error, or by flow in the default world (exact bounded)",
    )
    line.add_argument(
        "--workers", type=positive_integer, metavar="N", help="parallel runs (all cores)"
    )
    line.add_argument(
        "--out", metavar="DIR", help="output folder; resumes its campaign (runs/TIME-bench)"
    )
    line.add_argument("--write-only", action="store_true", help="write the files without flying")


def _settings(options: argparse.Namespace) -> tuple[tuple[str, str], ...]:
    """Return the settings that are chosen, in the order of the table."""
    chosen = tuple(
        (world, positions)
        for world, positions in SETTINGS
        if world in options.world and positions in options.positions
    )
    if not chosen:  # the ideal world with `flow`
        wrong = "--positions flow: exact in the ideal world; add --world default"
        raise InputError(wrong, "invalid-argument")
    return chosen


def _cases(options: argparse.Namespace) -> Iterator[Case]:
    """Yield every case in the order of the table."""
    names = set()
    for word in options.scenarios or CATALOGUE:
        name, values = named("--scenarios", word)
        if name not in CATALOGUE:
            hint = suggestion(name, CATALOGUE, "there are")
            raise InputError(f"--scenarios: no scenario named {name!r}{hint}", "invalid-argument")
        chosen = checked_options(name, values)
        for agents in dict.fromkeys(options.agents or numbers(name)):
            if not MIN_AGENTS <= agents <= MAX_AGENTS:
                wrong = f"--agents {agents}: expected a number from {MIN_AGENTS} to {MAX_AGENTS}"
                raise InputError(wrong, "out-of-range")
            for seed in range(options.seeds):
                case = Case(name, agents, seed, chosen)
                if case.name in names:
                    raise InputError(f"--scenarios: {word!r} is given twice", "duplicate-name")
                names.add(case.name)
                yield case


def _fly(study: Path, folder: Path, workers: int | None, registry: Registry) -> StudyResults:
    """Fly a study and return its results.

    Raises:
        InputError: No plugin flies studies, or this one cannot be flown.
    """
    results: StudyResults | None = registry.manager.hook.star_fly_study(
        study=study, folder=folder, workers=workers, registry=registry
    )
    if results is None:
        missing = (
            "the scenarios are a study, and no installed plugin flies studies, as `ablate` does"
        )
        raise InputError(missing, "unknown-plugin")
    return results


def _metrics(flown: StudyResults, campaign: Campaign) -> Iterator[tuple[Key, Metrics]]:
    """Yield the metrics of every flight of a study, in the order of the table."""
    flights = {
        (flight.mission, flight.levels[AVOIDER], flight.levels[SETTING]): flight
        for flight in flown.flights
    }
    drawn = {case.name: case.draw() for case in campaign.cases}
    for avoider in campaign.avoiders:
        for setting in campaign.settings:
            for case in campaign.cases:
                flight = flights.get((case.name, avoider, " ".join(setting)))
                if flight is not None:
                    key = Key(avoider, case.title, str(case.agents), *setting)
                    yield key, metrics(flight, drawn[case.name], SPEED)


def _titled(flown: StudyResults, campaign: Campaign) -> Iterator[StudyFlight]:
    """Yield every flight with its scenario and seed in place of the mission."""
    cases = {case.name: case for case in campaign.cases}
    for flight in flown.flights:
        case = cases[flight.mission]
        yield replace(flight, mission=f"{case.title}, {case.agents} agents", seed=case.seed)


NOT_IN_LABELS: Final = re.compile(r"[^A-Za-z0-9 _.+-]")


def named(flag: str, word: str) -> tuple[str, dict[str, Any]]:
    """Return the name and the options of a word such as ``orca=radius:0.25,horizon:2``.

    >>> named("--avoiders", "orca=radius:0.25,obstacles:none")
    ('orca', {'radius': 0.25, 'obstacles': 'none'})

    Raises:
        InputError: The word has another form.
    """
    name, equals, text = word.partition("=")
    options: dict[str, Any] = {}
    for part in text.split(",") if equals else ():
        key, colon, value = part.partition(":")
        if not (name and key and colon and value):
            wrong = f"{flag} {word!r}: expected NAME or NAME=OPTION:VALUE,OPTION:VALUE"
            raise InputError(wrong, "invalid-argument")
        try:
            options[key.strip()] = json.loads(value)
        except ValueError:
            options[key.strip()] = value.strip()
    return name, options


def levels(words: list[str], registry: Registry) -> dict[str, Any]:
    """Return the overrides of a mission for each avoider, by the label used in tables.

    Args:
        words: Values of the flag; empty for all installed avoiders.
        registry: Registry of the avoiders.

    Raises:
        InputError: There is no avoider of that name, or one is given twice.
    """
    by_label: dict[str, Any] = {}
    for word in words or registry.names("avoider"):
        name, options = named("--avoiders", word)
        try:
            registry.find("avoider", name)
        except PluginError as error:
            raise InputError(f"--avoiders: {error}", "unknown-plugin") from None
        label = label_of(name, options)
        if label in by_label:
            raise InputError(f"--avoiders: {label!r} is given twice", "duplicate-name")
        by_label[label] = {"use": name, **options} if options else name
    return by_label


def label_of(name: str, options: Mapping[str, Any]) -> str:
    """Return the label of a plugin with its options in tables: ``orca radius 0.25``."""
    return NOT_IN_LABELS.sub(
        "_", " ".join([name, *(f"{key} {value}" for key, value in options.items())])
    )
