"""A study is read, checked and laid out before anything flies."""

from __future__ import annotations

from importlib.metadata import entry_points
from pathlib import Path

import pytest

from star_ablate.reading import MEASURES, SEEDS, read, schema
from star_core import InputError, Registry, discovery
from star_core.toolkit import STUDY_COLUMNS
from tests.plugins.commands.star_ablate.conftest import Write

HOP = "missions: [../hop.yaml]\n"
TWO = """\
missions: [../hop.yaml, ../jump.yaml]
seeds: 1
factors:
  avoider: {none: {}, orca: {avoider: orca}}
  rate: {slow: {rate: 10}, fast: {rate: 20}}
"""


@pytest.fixture(scope="module")
def registry() -> Registry:
    return Registry()


def problems(path: Path, registry: Registry) -> list[str]:
    with pytest.raises(InputError) as caught:
        read(path, registry)
    return [problem.removeprefix(f"{path}:") for problem in caught.value.problems]


def test_every_combination_of_missions_and_levels_is_a_condition(
    study: Write, registry: Registry
) -> None:
    names = [condition.names for condition in read(study(TWO), registry).conditions]
    assert names == [
        (mission, avoider, rate)
        for mission in ("hop", "jump")
        for avoider in ("none", "orca")
        for rate in ("slow", "fast")
    ]


def test_excluded_combinations_are_not_flown(study: Write, registry: Registry) -> None:
    excluded = "exclude: [{avoider: orca, rate: fast}, {mission: jump, rate: slow}]\n"
    names = [condition.names for condition in read(study(TWO + excluded), registry).conditions]
    assert names == [
        ("hop", "none", "slow"),
        ("hop", "none", "fast"),
        ("hop", "orca", "slow"),
        ("jump", "none", "fast"),
    ]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("exclude: [{avoidr: orca}]", "8:20: no factor named 'avoidr'; did you mean 'avoider'?"),
        ("exclude: [{rate: medium}]", "8:18: no level of 'rate' named 'medium'; there are: slow"),
        ("baseline: {mission: jmp}", "8:21: no mission named 'jmp'; did you mean 'jump'?"),
        ("exclude: [{mission: hop}]", "8:10: every combination of mission 'hop' is excluded"),
        (
            "exclude: [{avoider: orca}]\nbaseline: {avoider: orca}",
            "9:11: every such combination is excluded",
        ),
        (
            "baseline: {mission: hop}\npair: seed and mission",
            "8:21: the missions are pooled by `pair: seed and mission`",
        ),
    ],
)
def test_impossible_designs_are_refused(
    text: str, problem: str, study: Write, registry: Registry
) -> None:
    (message,) = problems(study(f"{TWO}{text}\n"), registry)
    assert message.startswith(problem)


def test_a_level_sets_its_values_and_nothing_else(study: Write, registry: Registry) -> None:
    factors = "factors: {radius: {small: {avoider: {use: orca, radius: 0.2}, rate: 10}}}\n"
    (plain,) = read(study(HOP), registry).conditions
    (small,) = read(study(HOP + factors), registry).conditions
    expected = dict(plain.mission.source) | {"avoider": {"use": "orca", "radius": 0.2}, "rate": 10}
    assert small.mission.source == expected


def test_later_factors_set_options_of_earlier_choices(study: Write, registry: Registry) -> None:
    path = study(
        HOP + "factors:\n  avoider: {orca: {avoider: orca}}\n  radius: {a: {avoider.radius: 0.2}}\n"
    )
    (condition,) = read(path, registry).conditions
    assert dict(condition.mission.plugins["avoider"].written) == {"radius": 0.2}


def test_without_factors_the_missions_are_flown_as_they_are(
    study: Write, registry: Registry
) -> None:
    ablation = read(study(HOP), registry)
    assert [condition.names for condition in ablation.conditions] == [("hop",)]


@pytest.mark.parametrize(
    ("text", "count", "seeds"),
    [
        ("3", None, (0, 1, 2)),
        ("{count: 2}", None, (0, 1)),
        ("{first: 7, count: 2}", None, (7, 8)),
        ("[5, 3]", None, (5, 3)),
        ("[5, 3, 4]", 2, (5, 3)),
        ("[5, 3]", 4, (5, 3, 6, 7)),
    ],
)
def test_seeds_are_counted_or_listed(
    text: str, count: int | None, seeds: tuple[int, ...], study: Write, registry: Registry
) -> None:
    assert read(study(f"{HOP}seeds: {text}\n"), registry, count).seeds == seeds


def test_own_seeds_fly_each_mission_once_with_its_seed(study: Write, registry: Registry) -> None:
    path = study("missions: [../hop.yaml, ../jump.yaml]\nseeds: own\n")
    jump = path.parents[1] / "jump.yaml"
    jump.write_text(f"{jump.read_text()}seed: 41\n")
    runs = list(read(path, registry).runs())
    assert [(run.condition.file, run.mission().scene.seed) for run in runs] == [
        ("hop", 0),
        ("jump", 41),
    ]


def test_a_number_of_seeds_does_not_go_with_own_seeds(study: Write, registry: Registry) -> None:
    path = study(f"{HOP}seeds: own\n")
    with pytest.raises(InputError) as caught:
        read(path, registry, 3)
    assert caught.value.problems == (
        f"{path}:4:8: each mission flies with its 'own' seed, so --seeds 3 has no effect"
        " [option-conflict]",
    )


def test_seeds_in_another_word_than_own_are_refused(study: Write, registry: Registry) -> None:
    (problem,) = problems(study(f"{HOP}seeds: mine\n"), registry)
    assert problem.startswith("4:8: seeds: 'mine' is not possible here: expected a number of seeds")


def test_a_run_flies_with_its_seed(study: Write, registry: Registry) -> None:
    (run,) = read(study(f"{HOP}seeds: [41]\n"), registry).runs()
    assert run.mission().scene.seed == run.mission().source["seed"] == 41


def test_run_keys_are_unique_and_reproducible(study: Write, registry: Registry) -> None:
    text = HOP + "seeds: 3\nfactors: {same: {a: {}, b: {}}}\n"
    keys = [run.key for run in read(study(text), registry).runs()]
    assert len(set(keys)) == 6
    assert keys == [run.key for run in read(study(text), registry).runs()]


@pytest.mark.parametrize("file", ["hop.yaml", "room.yaml"])
def test_a_change_of_the_mission_or_its_world_changes_the_key(
    file: str, study: Write, registry: Registry
) -> None:
    path = study(f"{HOP}seeds: 1\n")
    (before,) = read(path, registry).runs()
    changed = path.parents[1] / file
    changed.write_text(changed.read_text().replace("name: ", "name: other-"))
    (after,) = read(path, registry).runs()
    assert before.key != after.key


def test_camera_files_of_levels_are_part_of_the_run_key(study: Write, registry: Registry) -> None:
    path = study(
        HOP + "seeds: 1\n"
        "factors: {lens: {a: {cameras.own.file: a.yaml}, b: {cameras.own.file: b.yaml}}}\n"
    )
    folder = path.parents[1]
    for name, width in (("a", 320), ("b", 322)):
        (folder / f"{name}.yaml").write_text(f"star: 1\nname: {name}\nwidth: {width}\n")
    first, second = read(path, registry).conditions
    assert [c.mission.source["cameras"]["own"]["width"] for c in (first, second)] == [320, 322]
    before = [run.key for run in read(path, registry).runs()]
    (folder / "b.yaml").write_text("star: 1\nname: b\nwidth: 324\n")
    after = [run.key for run in read(path, registry).runs()]
    assert (before[0] == after[0], before[1] == after[1]) == (True, False)


def test_another_version_of_a_plugin_changes_the_key(
    study: Write, wrecker: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(discovery, "entry_points", entry_points)  # read again
    path = study(f"{HOP}seeds: 1\nfactors: {{avoider: {{wrecker: {{avoider: wrecker}}}}}}\n")
    (before,) = read(path, Registry()).runs()
    about = wrecker / "star_wrecker-1.0.dist-info" / "METADATA"
    about.write_text(about.read_text().replace("1.0", "1.1"))
    (after,) = read(path, Registry()).runs()
    assert before.key != after.key


@pytest.mark.parametrize(
    ("text", "where", "code"),
    [
        ("missions: [../hip.yaml]\n", "3:12", "file-not-found"),
        ("missions: [../../x.yaml]\n", "3:12", "file-not-found"),
        ("missions: [/etc/hosts]\n", "3:12", "file-not-found"),
        (HOP + "factors: {seed: {a: {}}}\n", "4:17", "duplicate-name"),
        (HOP + "factors: {noise: {a: {seed: 3}}}\n", "4:29", "option-conflict"),
        (
            HOP + "factors: {a: {b: {avoider.radius: 1}}, c: {d: {avoider: none}}}\n",
            "4:57",
            "option-conflict",
        ),
        (HOP + "factors: {a: {b: {rate: 1}}, c: {d: {rate: 2}}}\n", "4:44", "option-conflict"),
    ],
)
def test_a_mistake_is_refused_at_its_location(
    text: str, where: str, code: str, study: Write, registry: Registry
) -> None:
    (problem,) = problems(study(text), registry)
    assert problem.startswith(f"{where}: ")
    assert problem.endswith(f"[{code}]")


def test_a_similar_file_is_suggested(study: Write, registry: Registry) -> None:
    (problem,) = problems(study("missions: [../hip.yaml]\n"), registry)
    assert "did you mean '../hop.yaml'?" in problem


def test_a_link_does_not_lead_out_of_the_folder(
    study: Write, registry: Registry, tmp_path: Path
) -> None:
    path = study("missions: [link.yaml]\n")
    (tmp_path / "elsewhere.yaml").write_text("star: 1\n")
    (path.parent / "link.yaml").symlink_to(tmp_path / "elsewhere.yaml")
    (problem,) = problems(path, registry)
    assert "'link.yaml' is outside the folder above the study's" in problem


def test_two_missions_of_one_name_cannot_be_distinguished(study: Write, registry: Registry) -> None:
    path = study("missions: [../hop.yaml, hop.yaml]\n")
    (path.parent / "hop.yaml").write_text("star: 1\n")
    first = path.parent / "../hop.yaml"
    assert problems(path, registry) == [
        f"3:25: 'hop.yaml' is indistinguishable from {str(first)!r} in the results; rename one"
        " [duplicate-name]"
    ]


def test_what_a_level_sets_wrongly_is_located_in_the_study(
    study: Write, registry: Registry
) -> None:
    path = study(HOP + "factors: {radius: {odd: {avoider: {use: orca, radius: -1}}, even: {}}}\n")
    (problem,) = problems(path, registry)
    assert problem.startswith("4:35: ")
    assert "; with radius: odd [" in problem
    assert "-1" in problem


def test_levels_invalid_for_every_mission_are_reported_once(
    study: Write, registry: Registry
) -> None:
    text = "missions: [../hop.yaml, ../jump.yaml]\nfactors: {fast: {very: {rate: -1}}}\n"
    (problem,) = problems(study(text), registry)
    assert "-1" in problem


def test_mission_problems_at_every_level_are_reported_once(
    study: Write, registry: Registry
) -> None:
    path = study(HOP + "factors: {rate: {a: {rate: 10}, b: {rate: 20}}}\n")
    (path.parents[1] / "hop.yaml").write_text("star: 1\nname: hop\n")
    messages = problems(path, registry)
    assert len(messages) == len(set(messages)) > 0
    assert all("hop.yaml:1:1: " in problem and "; with" not in problem for problem in messages)


def test_the_schema_has_the_defaults_that_are_used() -> None:
    properties = schema(Registry())["properties"]
    assert properties["measures"]["default"] == list(MEASURES)
    assert properties["seeds"]["default"] == SEEDS


def test_every_property_of_the_schema_is_described() -> None:
    waiting = [schema(Registry())]
    described = 0
    while waiting:
        rules = waiting.pop()
        for part in rules.get("properties", {}).values():
            assert part["description"]
            described += 1
            waiting.append(part)
        waiting += [p for p in [rules.get("additionalProperties")] if isinstance(p, dict)]
    assert described >= 9


def test_the_columns_of_the_results_are_no_names_of_factors() -> None:
    assert {"mission", "seed", "outcome", "reason"} == set(STUDY_COLUMNS)
