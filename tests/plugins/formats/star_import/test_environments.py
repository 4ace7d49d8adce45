"""Environments of the original STAR."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from star_core import InputError, Registry, World, load
from tests.plugins.formats.star_import.conftest import Import

Put = Callable[[str, str], str]
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
def world(place: Put, take: Import) -> Callable[..., World]:
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


def refused(take: Import, place: Put, text: str, *arguments: str) -> list[str]:
    place("lab.yaml", text)
    with pytest.raises(InputError) as raised:
        take("lab.yaml", *arguments)
    return list(raised.value.problems)


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


def test_a_point_that_is_repeated_and_an_odd_number_are_reported(place: Put, take: Import) -> None:
    place("lab.yaml", OBSTACLE.format(offsets="true", points="[1, 1, 0, 0, 0, 1, 7]"))
    told = take("lab.yaml")
    assert "lab.yaml:7:15: obs0: the last of 7 numbers has no pair; ignored" in told
    assert "lab.yaml:7:15: obs0: [1, 1] is repeated; used once" in told


def test_the_fence_is_drawn_around_everything_and_reported(place: Put, take: Import) -> None:
    place("lab.yaml", OBSTACLE.format(offsets="false", points="[-1, 0, 1, 0]"))
    assert "fence: not in the files; from [-2.1, -1.1, 0] to [2.1, 1.1, 2.2] m" in take("lab.yaml")


PAIR = "id000 id001: {alignment: top-left, location: [1.0, 0.0], purpose: relocalization}"


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
    world: World_, place: Put, take: Import
) -> None:
    text = TAGS.format(tags="id100: {location: [0.0], purpose: eliminate}")
    place("lab.yaml", text)
    (line,) = [line for line in take("lab.yaml", *FENCE) if "id100" in line]
    assert line == (
        "lab.yaml:5:23: id100 has no position and is ignored; to add it to the world: --target "
        "100=X,Y"
    )
    (target,) = world(text, *FENCE, "--target", "100=1,2").targets
    assert target.position == (1.0, 2.0, 0.0)


def test_three_numbers_of_a_place_are_its_first_two(world: World_) -> None:
    tags = "id100: {location: [2.0, 0,0], purpose: eliminate}"
    (target,) = world(TAGS.format(tags=tags), *FENCE).targets
    assert target.position == (2.0, 0.0, 0.0)


def test_what_an_import_does_not_read_is_reported(place: Put, take: Import) -> None:
    tag = "id100: {location: [2.0, 0.0], purpose: eliminate, size: 0.08, alignment: top-left}"
    place("lab.yaml", "lights: off\n" + TAGS.format(tags=tag))
    told = take("lab.yaml", *FENCE)
    assert "lab.yaml:1:9: 'lights' is not supported; ignored" in told
    assert "lab.yaml:6:61: id100: 'size' is not read by the original; ignored" in told
    assert "id100: 'alignment' is not read by the original; ignored" in "\n".join(told)


def test_one_file_of_commands_and_walls_is_imported_whole(place: Put, take: Import) -> None:
    walls = OBSTACLE.format(offsets="false", points="[-1, 0, 1, 0]")
    place("both.yaml", 'command_sequence: ["takeoff", "wait", "all", "", ""]\n' + walls)
    told = "\n".join(take("both.yaml", *FENCE, "--agent", "cf1=0,0.5"))
    assert "obs0" in told
    assert "'environment' is nothing" not in told


def test_a_tag_for_something_else_is_left_out_and_reported(place: Put, take: Import) -> None:
    place("lab.yaml", TAGS.format(tags="id100: {location: [2.0, 0.0], purpose: fun}"))
    described = "lab.yaml:5:12: id100 is for 'fun', which the original ignores; ignored"
    assert described in take("lab.yaml")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (OBSTACLE.format(offsets="true", points="[1, 1]"),
         "lab.yaml:7:15: obs0 has 2 numbers, expected x and y of two points [invalid-input]"),
        (OBSTACLE.format(offsets="true", points="[1, 1, 0, 0]"),
         "lab.yaml:7:15: obs0 has one point only, expected two that differ [invalid-input]"),
        (OBSTACLE.format(offsets="maybe", points="[1, 1, 1, 0]"),
         "lab.yaml:4:22: is 'maybe', expected true or false [wrong-type]"),
        (OBSTACLE.format(offsets="true", points="[1, 1, 1, x]"),
         "lab.yaml:7:25: is 'x', expected a number [wrong-type]"),
        (OBSTACLE.format(offsets="true", points="[1, 1, 1, 0]").replace("thickness: 0.2", "a: 1"),
         "lab.yaml:4:7: has no 'thickness' [missing-option]"),
        (OBSTACLE.format(offsets="true", points="[1, 1, 1, 0]").replace("[0.0, 1.5]", "[0]"),
         "lab.yaml:5:15: obs0: expected z of the bottom and of the top, m [invalid-input]"),
        (OBSTACLE.format(offsets="true", points="[1, 1, 1, 0]").replace("[0.0, 1.5]", "[2, 1]"),
         "lab.yaml:4:7: as STAR reads it: obstacle 'obs0' has its foot at 2 m, not below its top "
         "at 1 m [empty-range]"),
        (TAGS.format(tags="id1: {location: [1.0, 0.0], purpose: eliminate}"),
         "lab.yaml:5:10: 'id1', expected a tag 'id000' or a pair 'id000 id001' [invalid-input]"),
        (TAGS.format(tags=PAIR.replace("top-left", "middle")),
         "lab.yaml:5:30: id000 id001: no corner 'middle', expected one of top-left, top-right, "
         "bottom-right, bottom-left [invalid-input]"),
        (TAGS.format(tags="id001: {location: [1.0], purpose: relocalization}"),
         "lab.yaml:5:23: id001 has 1 numbers, expected x and y, m [invalid-input]"),
        (TAGS.format(tags=PAIR).replace("-0.3105", "-0.2315"),
         "lab.yaml:2:18: id000 id001: tags 0.122 m apart overlap at an edge of 0.157 m; give "
         "their size: --tag-size 0.097 or less [invalid-input]"),
        (TAGS.format(tags="id600: {location: [1.0, 0.0], purpose: eliminate}"),
         "lab.yaml:5:12: as STAR reads it: targets.target_600.tags: 600 is greater than the "
         "maximum of 586 [out-of-range]"),
        ("a: 1\n",
         "lab.yaml:1:1: contains none of 'command_sequence', 'environment', 'april_tags' (the "
         "original STAR) and 'robots' (Crazyswarm2) [invalid-input]"),
    ],
)  # fmt: skip
def test_what_cannot_be_expressed_is_refused_with_its_place(
    place: Put, take: Import, text: str, expected: str
) -> None:
    assert refused(take, place, text) == [expected]


def test_smaller_tags_may_lie_nearer(world: World_) -> None:
    text = TAGS.format(tags=PAIR).replace("-0.3105", "-0.2315")
    assert len(world(text, *FENCE, "--tag-size", "0.09").landmarks) == 2


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("--target", "1=2"), "--target 1=2: expected TAG=X,Y in m [invalid-input]"),
        (("--agent", "cf1"), "--agent cf1: expected NAME=X,Y or NAME=X,Y,Z in m [invalid-input]"),
        (("--name", "_."), "'_.' has no letter to form a name; give --name [invalid-input]"),
    ],
)
def test_what_is_wrong_with_an_option_is_reported(
    place: Put, take: Import, arguments: tuple[str, str], expected: str
) -> None:
    option, value = arguments
    text = OBSTACLE.format(offsets="false", points="[-1, 0, 1, 0]")
    assert refused(take, place, text, f"{option}={value}") == [expected]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "lab.yaml:1:1: the file is empty"),
        ("a: &x 1\nb: *x\n", "lab.yaml:1:4: anchor '&x' is refused; write the value out"),
        ("a: [1\n", "lab.yaml:1:4: '[' is not closed"),
        ("a: 1\na: 2\n", "lab.yaml:2:1: key 'a' is already there"),
        ("robots: 1e999\n", "lab.yaml:1:9: 1e999 is not a plain, finite decimal number"),
        ("robots: .inf\n", "lab.yaml:1:9: .inf is not a plain, finite decimal number"),
        ("robots: 1\n", "lab.yaml:1:9: is 1, expected a map"),
        ("? [a]\n: 1\n", "lab.yaml:1:3: a map or a list cannot be a key"),
        ("a: " + "[" * 40 + "]" * 40 + "\n", "lab.yaml:1:35: nested deeper than 32 levels"),
    ],
)
def test_what_is_no_yaml_is_refused(place: Put, take: Import, text: str, expected: str) -> None:
    (problem,) = refused(take, place, text)
    assert problem.startswith(expected)


def test_a_file_that_is_not_there_is_reported(take: Import) -> None:
    with pytest.raises(InputError, match=r"no\.yaml: no such file"):
        take("no.yaml")


def test_two_files_of_one_sort_are_refused(place: Put, take: Import) -> None:
    place("a.yaml", "command_sequence: []\n")
    place("b.yaml", "command_sequence: []\n")
    with pytest.raises(InputError, match=r"b\.yaml: same kind of file as a\.yaml"):
        take("a.yaml", "b.yaml")
