"""Environments of the original STAR."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from star_core import Registry, World, load
from star_core.toolkit import actions
from tests.plugins.formats.star_import.conftest import Import, place, refusals

OBSTACLE = """\
environment:
  obstacles:
    obs0:
      use_key_point: {offsets}
      height: [0.0, 1.5]
      thickness: 0.2
      points: {points}
"""
TAGS = """\
april_tags:
  pair_position: [-0.122, -0.1095, -0.122, -0.3105]
  pair_paper_size: [0.297, 0.420]
  tags:
    {tags}
"""


@pytest.fixture
def world(take: Import) -> Callable[..., World]:
    """Import an environment and return the world that came out."""

    def made(text: str, *arguments: str) -> World:
        place("lab.yaml", text)
        take("lab.yaml", "--force", *arguments)
        place(
            "imported/probe.yaml",
            "star: 1\nname: probe\nworld: worlds/lab.yaml\nswarm: {a: {start: [-9, -9, 0]}}\n"
            "transport: sim\nlocalizer: flow\nplanner: straight\navoider: none\n"
            "mission: [hold: {}]\n",
        )
        return load(Path("imported/probe.yaml"), Registry()).scene.world

    return made


FENCE = ("--fence", "-9", "-9", "0", "9", "9", "3")
World_ = Callable[..., World]


def test_points_after_the_first_are_offsets_of_a_key_point(world: World_) -> None:
    text = OBSTACLE.format(offsets="true", points="[1.0, 1.0, -0.5, -0.0, 0.0, -2.0]")
    (obstacle,) = world(text, *FENCE).obstacles
    assert [len(piece) for piece in obstacle.polygons] == [4, 4]
    assert obstacle.contains((0.5, 0.0, 1.0))
    assert obstacle.height == (0.0, 1.5)


def test_points_without_a_key_point_are_absolute(world: World_) -> None:
    text = OBSTACLE.format(offsets="false", points="[1.0, 1.0, -1.0, 1.0]")
    (obstacle,) = world(text, *FENCE).obstacles
    assert obstacle.contains((0.0, 1.05, 1.0))
    assert not obstacle.contains((0.0, 1.15, 1.0))


def test_a_point_that_is_repeated_and_an_odd_number_are_reported(take: Import) -> None:
    place("lab.yaml", OBSTACLE.format(offsets="true", points="[1, 1, 0, 0, 0, 1, 7]"))
    told = take("lab.yaml")
    assert "ignored lab.yaml:7:15: obs0: the last number of 'points' has no pair" in told
    assert "ignored lab.yaml:7:15: obs0: a point is repeated" in told


def test_the_fence_is_drawn_around_everything_and_reported(take: Import) -> None:
    place("lab.yaml", OBSTACLE.format(offsets="false", points="[-1, 0, 1, 0]"))
    place("m.yaml", 'command_sequence: ["takeoff", "wait", "all", "", ""]')
    text = "assumed fence: from [-2.1, -1.1, 0] to [2.1, 1.5, 2.2] m, around everything"
    assert text in take("m.yaml", "lab.yaml", "--agent", "a=0,0.5")


PAIR = "id000 id001: {alignment: top-left, location: [1.0, 0.0], purpose: relocalization}"


def test_an_obstacle_above_all_heights_is_in_the_fence(take: Import) -> None:
    text = OBSTACLE.format(offsets="true", points="[1.0, 1.0, 0.0, 2.0]")
    place("high.yaml", text.replace("[0.0, 1.5]", "[2.3, 4.0]"))
    take("high.yaml")
    assert "high: [2.1, 4.1, 2.5]}" in Path("imported/worlds/high.yaml").read_text("utf-8")


def test_tags_lie_where_the_original_flew_them_as_executed(world: World_) -> None:
    """The figures are those of the original's own lab: (1 - 0.122 + 0.157 / 2, ...)."""
    first, second = world(TAGS.format(tags=PAIR), *FENCE, "--as-executed").landmarks
    assert first.position == pytest.approx((0.9565, -0.0310, 0.0))
    assert second.position == pytest.approx((0.9565, -0.2320, 0.0))


def test_places_are_those_of_the_middles_by_default(world: World_) -> None:
    first, _ = world(TAGS.format(tags=PAIR), *FENCE).landmarks
    assert first.position == pytest.approx((0.878, -0.1095, 0.0))
    corner, _ = world(TAGS.format(tags=PAIR), *FENCE, "--tag-origin", "corner").landmarks
    assert corner.position == pytest.approx((0.9565, -0.0310, 0.0))


@pytest.mark.parametrize(
    ("corner", "dx", "dy"),
    [("top-right", 0, 0.42), ("bottom-right", 0.297, 0.42), ("bottom-left", 0.297, 0)],
)
def test_the_place_is_that_of_the_corner_that_is_named(
    world: World_, corner: str, dx: float, dy: float
) -> None:
    first, _ = world(TAGS.format(tags=PAIR.replace("top-left", corner)), *FENCE).landmarks
    assert first.position == pytest.approx((0.878 + dx, -0.1095 + dy, 0.0))


def test_tags_to_eliminate_are_targets(world: World_) -> None:
    tags = "id100: {location: [0.5, -0.5], purpose: eliminate}"
    (target,) = world(TAGS.format(tags=tags), *FENCE).targets
    assert (target.id, target.position, target.size) == (100, (0.5, -0.5, 0.0), 0.157)


def test_a_target_without_a_place_is_reported_and_can_be_placed(
    world: World_, take: Import
) -> None:
    text = TAGS.format(tags="id100: {location: [0.0], purpose: eliminate}")
    place("lab.yaml", text)
    (line,) = [line for line in take("lab.yaml", *FENCE) if "id100" in line]
    assert line == (
        "ignored lab.yaml:5:23: id100: targets without a position are not in the world; --target "
        "TAG=X,Y adds one"
    )
    (target,) = world(text, *FENCE, "--target", "100=1,2").targets
    assert target.position == (1.0, 2.0, 0.0)


def test_three_numbers_of_a_place_are_its_first_two(world: World_) -> None:
    tags = "id100: {location: [2.0, 0,0], purpose: eliminate}"
    (target,) = world(TAGS.format(tags=tags), *FENCE).targets
    assert target.position == (2.0, 0.0, 0.0)


def test_what_an_import_does_not_read_is_reported(take: Import) -> None:
    tag = "id100: {location: [2.0, 0.0], purpose: eliminate, size: 0.08, alignment: top-left}"
    place("lab.yaml", "lights: off\n" + TAGS.format(tags=tag))
    told = take("lab.yaml", *FENCE)
    assert "ignored lab.yaml:1:9: lights: is not supported" in told
    assert "ignored lab.yaml:6:61: tags.size: is not read by the original" in told
    assert "tags.alignment: is not read by the original" in "\n".join(told)


def test_one_file_of_commands_and_walls_is_imported_whole(take: Import) -> None:
    walls = OBSTACLE.format(offsets="false", points="[-1, 0, 1, 0]")
    place("both.yaml", 'command_sequence: ["takeoff", "wait", "all", "", ""]\n' + walls)
    take("both.yaml", *FENCE, "--agent", "cf1=0,0.5")
    mission = load(Path("imported/both.yaml"), Registry())
    assert [obstacle.name for obstacle in mission.scene.world.obstacles] == ["obs0"]


def test_a_tag_for_something_else_is_left_out_and_reported(take: Import) -> None:
    place("lab.yaml", TAGS.format(tags="id100: {location: [2.0, 0.0], purpose: fun}"))
    described = "ignored lab.yaml:5:12: id100: the original has no purpose 'fun'"
    assert described in take("lab.yaml")


def test_tags_that_overlap_are_as_large_as_fit(world: World_, take: Import) -> None:
    text = TAGS.format(tags=PAIR).replace("-0.3105", "-0.2315")
    assert {tag.size for tag in world(text, *FENCE).landmarks} == {0.097}
    assert {tag.size for tag in world(text, *FENCE, "--tag-size", "0.09").landmarks} == {0.09}
    place("lab.yaml", text)
    assert (
        "changed lab.yaml:5:18: tags_0_1: tags 0.122 m apart overlap at an edge of 0.157 m; their "
        "edges are 0.097 m" in take("lab.yaml", *FENCE, "--force")
    )


def test_a_tag_on_another_sheet_shrinks_or_is_left_out(world: World_) -> None:
    near = "id005: {location: [1.1, 0.0], purpose: eliminate}"
    same = "id006: {location: [1.1, 0.01], purpose: eliminate}"
    room = world(TAGS.format(tags=f"{near}\n    {same}"), *FENCE)
    assert [(tag.id, tag.size) for tag in room.targets] == [(5, 0.157)]
    apart = same.replace("0.01", "0.15")
    room = world(TAGS.format(tags=f"{near}\n    {apart}"), *FENCE)
    assert [(tag.id, tag.size) for tag in room.targets] == [(5, 0.12), (6, 0.12)]


def test_walls_end_flat_unless_they_are_expanded(world: World_) -> None:
    text = OBSTACLE.format(offsets="false", points="[-1, 0, 1, 0]")
    (obstacle,) = world(text, *FENCE).obstacles
    assert not obstacle.contains((1.05, 0.0, 1.0))
    for factor, beyond in ((1.0, False), (3.5, True)):
        place("config.yaml", f"environment_file: lab.yaml\nobstacle_expansion_factor: {factor}\n")
        (obstacle,) = world(text, *FENCE, "config.yaml").obstacles
        assert obstacle.contains((1.05, 0.0, 1.0)) == beyond


@pytest.mark.parametrize(
    ("agent", "tags", "names"),
    [
        ("a=0,0.5", "", []),
        ("a=0,0.05", "", ["obs0"]),  # starts in it
        ("a=0,0.25", "", ["obs0"]),  # starts 0.15 m from it
        ("a=0,0.5", "id007: {location: [0.5, 0.0], purpose: eliminate}", ["obs0"]),
        ("a=0,0.5", "id007: {location: [0.5, 0.1], purpose: relocalization}", []),  # on its face
    ],
)
def test_obstacles_with_starts_or_tags_in_them_are_virtual(
    take: Import, agent: str, tags: str, names: list[str]
) -> None:
    text = OBSTACLE.format(offsets="false", points="[-1, 0, 1, 0]")
    place("lab.yaml", text + (TAGS.format(tags=tags) if tags else ""))
    place("m.yaml", 'command_sequence: ["takeoff", "wait", "all", "", ""]')
    notes = take("m.yaml", "lab.yaml", "--agent", agent, *FENCE)
    world = load(Path("imported/m.yaml"), Registry()).scene.world
    assert [obstacle.name for obstacle in world.virtual] == names
    assert bool([note for note in notes if "obs0: is virtual, since" in note]) == bool(names)


def test_obstacles_at_goals_are_virtual_and_so_are_those_named(take: Import) -> None:
    place("lab.yaml", OBSTACLE.format(offsets="false", points="[-1, 0, 1, 0]"))
    up = '"takeoff", "wait", "all", "", ""'
    place("m.yaml", f'command_sequence: [{up}, "goto", "wait", "all", "", "0 -0.2 1 0"]')
    take("m.yaml", "lab.yaml", "--agent", "a=0,1")
    assert load(Path("imported/m.yaml"), Registry()).scene.world.obstacles == ()
    place("m.yaml", f'command_sequence: [{up}, "goto", "wait", "all", "", "0 -1 1 0"]')
    cases = {(): 1, ("--virtual", "obs0"): 0, ("--virtual", "all"): 0, ("--as-executed",): 0,
             ("--as-executed", "--solid", "obs0"): 1}  # fmt: skip
    for flags, count in cases.items():
        take("m.yaml", "lab.yaml", "--agent", "a=0,1", "--force", *flags)
        world = load(Path("imported/m.yaml"), Registry()).scene.world
        assert len(world.obstacles) == count


def test_crowded_starts_make_positions_exact_and_obstacles_virtual(take: Import) -> None:
    place("lab.yaml", OBSTACLE.format(offsets="false", points="[-1, 0, 1, 0]"))
    place("m.yaml", 'command_sequence: ["takeoff", "wait", "all", "", ""]')
    for x, margin, count in ((0.3, 0, 0), (0.5, 2, 1)):
        take("m.yaml", "lab.yaml", "--agent", "a=0,1", "--agent", f"b={x},1", "--force")
        scene = load(Path("imported/m.yaml"), Registry()).scene
        assert (scene.limits.uncertainty_margin, len(scene.world.obstacles)) == (margin, count)


def test_agents_at_one_goal_make_positions_exact(take: Import) -> None:
    up, goto = '"takeoff", "wait", "all", "", ""', '"goto", "wait", "{}", "", "0 0 1 0"'
    for names, margin in (("all", 0), ("a b", 0), ("a", 2)):
        place("m.yaml", f"command_sequence: [{up}, {goto.format(names)}]")
        notes = take("m.yaml", "--agent", "a=0,1", "--agent", "b=2,1", "--force")
        mission = load(Path("imported/m.yaml"), Registry())
        (goto_step,) = [step for step in actions(mission.steps) if step.verb == "goto"]
        assert goto_step.written["within"] == (0.2 if names == "a" else 0.1)
        assert mission.scene.limits.uncertainty_margin == margin
        assert any("positions are treated as exact" in note for note in notes) == (margin == 0)


def test_solid_obstacles_with_starts_in_them_are_refused() -> None:
    place("lab.yaml", OBSTACLE.format(offsets="false", points="[-1, 0, 1, 0]"))
    place("m.yaml", 'command_sequence: ["takeoff", "wait", "all", "", ""]')
    (refused,) = refusals("m.yaml", "lab.yaml", "--agent", "a=0,0.05", "--solid", "all")
    assert refused.endswith(" [inside-obstacle]")


@pytest.mark.parametrize("flag", ["--virtual", "--solid"])
def test_obstacles_that_do_not_exist_are_refused(flag: str) -> None:
    place("lab.yaml", OBSTACLE.format(offsets="false", points="[-1, 0, 1, 0]"))
    place("m.yaml", 'command_sequence: ["takeoff", "wait", "all", "", ""]')
    refused = refusals("m.yaml", "lab.yaml", "--agent", "a=0,1", flag, "obs1")
    assert refused == [f"{flag} obs1 [unknown-obstacle]"]


@pytest.mark.parametrize(
    ("option", "about"),
    [
        ("--target=1=2", "--target 1=2"),
        ("--agent=cf1", "--agent cf1"),
        ("--name=_.", "'_.' has no letter to form a name; give --name [invalid-input]"),
    ],
)
def test_what_is_wrong_with_an_option_is_reported(option: str, about: str) -> None:
    place("lab.yaml", OBSTACLE.format(offsets="false", points="[-1, 0, 1, 0]"))
    assert refusals("lab.yaml", option) == [f"{about} [invalid-input]"]


def test_files_of_other_programs_are_refused() -> None:
    place("lab.yaml", "a: 1\n")
    assert refusals("lab.yaml") == ["lab.yaml [wrong-file]"]
