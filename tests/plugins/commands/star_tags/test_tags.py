"""Sheets that ``star tags`` writes show the right tag, the right way up, in true size."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

import cv2
import numpy as np
import pytest

from star_core import InputError, Registry
from star_core.toolkit import PAPERS, TAG_RIM, TAG_SIZE, Fill, Text, rectangle
from star_core.toolkit.printed_page import coordinate
from star_tags.plan import plan_pages
from star_tags.sheet import BAR, STRIP, Sheet, lay_out
from star_tags.world import pages
from star_yaml import schema as schemas
from tests.commands import Printed, command

main = command("tags")

World: TypeAlias = Callable[[str], Path]
Areas: TypeAlias = list[tuple[float, list[list[tuple[float, float]]]]]
Sheets: TypeAlias = Callable[..., list[tuple[tuple[float, float], Areas, list[str]]]]

HEAD = "star: 1\nname: lab\nfence: {low: [-2, -2, 0], high: [2, 2, 2]}\n"
TAGS = """\
landmarks:
  corner: {tags: [0, 1], at: [1.4, 1.4, 0.0], yaw_deg: 90}
  wall (é): {tags: [17], at: [0, 2, 1.0], roll_deg: 90, size: 0.1}
targets:
  survivor & co: {tags: [586], at: [0.5, -1.0, 0.0], size: 0.05}
"""
EDGES = {0: 168.0, 1: 168.0, 17: 100.0, 586: 50.0}  # mm
FINE = 4  # pixels a millimetre


@pytest.fixture
def world(tmp_path: Path) -> World:
    def write(text: str) -> Path:
        path = tmp_path / "lab.yaml"
        path.write_text(HEAD + text, encoding="utf-8")
        return path

    return write


def printed(size: tuple[float, float], areas: Areas) -> np.ndarray:
    """The page as a picture of `FINE` pixels a millimetre."""
    picture = np.full([round(FINE * length) for length in reversed(size)], 255, np.uint8)
    for gray, outlines in areas:
        for outline in outlines:  # shifted by half a pixel: that is where OpenCV has its edges
            corners = np.round((FINE * np.array(outline) - 0.5) * 16).astype(np.int32)
            cv2.fillPoly(picture, [corners], int(255 * gray), shift=4)
    return picture


def detect_tags(picture: np.ndarray) -> tuple[list[int], np.ndarray]:
    """The tags that OpenCV finds, and the corners of each in mm, from its upper left clockwise."""
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    corners, ids, _ = cv2.aruco.ArucoDetector(family).detectMarkers(picture)
    return [int(n) for n in np.ravel(ids)], (np.array(corners).reshape(-1, 4, 2) + 0.5) / FINE


# The sheets


@pytest.mark.parametrize("form", ["pdf", "svg"])
def test_each_page_shows_its_tag_upright_and_in_true_size(
    form: str, world: World, sheets: Sheets
) -> None:
    for (tag, edge), (size, areas, _) in zip(EDGES.items(), sheets(world(TAGS), form), strict=True):
        tags, corners = detect_tags(printed(size, areas))
        assert tags == [tag]
        left, top = corners[0].min(axis=0)
        upright = [[left, top], [left + edge, top], [left + edge, top + edge], [left, top + edge]]
        assert corners[0] == pytest.approx(np.array(upright), abs=2 / FINE)


@pytest.mark.parametrize("form", ["pdf", "svg"])
def test_the_black_square_has_the_very_size(form: str, world: World, sheets: Sheets) -> None:
    for edge, (_, areas, _) in zip(EDGES.values(), sheets(world(TAGS), form), strict=True):
        tag = np.array([corner for outline in areas[0][1] for corner in outline])
        assert np.ptp(tag, axis=0) == pytest.approx([edge, edge], abs=1e-3)


@pytest.mark.parametrize("form", ["pdf", "svg"])
@pytest.mark.parametrize("paper", PAPERS)
def test_a_page_is_as_large_as_the_paper(
    form: str, paper: str, world: World, sheets: Sheets
) -> None:
    for size, _, _ in sheets(world(TAGS), form, paper):
        assert size == pytest.approx(PAPERS[paper], abs=1e-3)


@pytest.mark.parametrize("form", ["pdf", "svg"])
def test_the_rim_is_white(form: str, world: World, sheets: Sheets) -> None:
    for edge, (size, areas, _) in zip(EDGES.values(), sheets(world(TAGS), form), strict=True):
        picture = printed(size, areas)
        tag = FINE * np.array([corner for outline in areas[0][1] for corner in outline])
        (left, top), (right, bottom) = tag.min(axis=0), tag.max(axis=0)
        rim = FINE * edge / 8 - 2  # less two pixels of the frame and of the edge
        rows = slice(round(top - rim), round(bottom + rim))
        columns = slice(round(left - rim), round(right + rim))
        around = picture[rows, columns].copy()
        inner = slice(round(rim) - 2, -round(rim) + 2)
        around[inner, inner] = 255
        assert around.min() == 255


@pytest.mark.parametrize("form", ["pdf", "svg"])
def test_a_page_has_a_bar_of_100_mm_and_an_arrow_that_points_up(
    form: str, world: World, sheets: Sheets
) -> None:
    for _, areas, _ in sheets(world(TAGS), form):
        _, _, (_, bar), (_, (shaft, head)) = areas
        ends = np.array([x for outline in bar for x, _ in outline])
        assert np.ptp(ends) == pytest.approx(BAR) == 100
        foot, tip = np.array(shaft), np.array(head)
        assert len(head) == 3
        widest = np.ptp(tip[tip[:, 1] == tip[:, 1].max()][:, 0])
        assert tip[:, 1].min() < foot[:, 1].min()  # y is down
        assert widest > np.ptp(foot[:, 0])


@pytest.mark.parametrize("form", ["pdf", "svg"])
def test_a_page_shows_the_number_and_the_position_of_its_tag(
    form: str, world: World, sheets: Sheets
) -> None:
    texts = [page[2] for page in sheets(world(TAGS), form)]
    assert [lines[0] for lines in texts] == [f"tag {number}" for number in EDGES]
    assert texts[1][1] == "corner, a landmark of lab: 2 of 2 from the left, middles 210 mm apart"
    assert texts[1][2] == (
        "middle of the row at [1.4, 1.4, 0] m in the map, roll 0°, pitch 0°, yaw 90°"
    )
    assert texts[2][1] == "wall (é), a landmark of lab"
    assert texts[3][1] == "survivor & co, a target of lab"
    assert texts[3][3].startswith("The bar is 100 mm, the black square 50 mm wide: ")


def test_nothing_overlaps_the_tag_with_its_rim() -> None:
    for paper, (width, height) in PAPERS.items():
        largest = min(width, height - STRIP) / 1000 / TAG_RIM
        page = lay_out(Sheet(3, largest, ("a", "b")), paper)
        tag, _, *others = page.marks
        assert isinstance(tag, Fill)
        lowest = min(y for outline in tag.outlines for _, y in outline) - 1000 * largest / 8
        tops = [mark.at[1] + mark.size for mark in others if isinstance(mark, Text)]
        tops += [y for m in others if isinstance(m, Fill) for o in m.outlines for _, y in o]
        assert max(tops) <= lowest + 1e-6


def test_every_outline_goes_round_the_same_way() -> None:
    """Else outlines of one area would cut holes into each other."""
    for mark in lay_out(Sheet(3, 0.1, ()), "a4").marks:
        for outline in mark.outlines if isinstance(mark, Fill) else ():
            x, y = np.array(outline).T
            assert np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) > 0


def test_the_black_modules_of_a_tag_do_not_overlap() -> None:
    tag = lay_out(Sheet(5, 0.08, ()), "a4").marks[0]
    assert isinstance(tag, Fill)
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    black = np.count_nonzero(family.generateImageMarker(5, 8) == 0)
    area = sum((o[1][0] - o[0][0]) * (o[2][1] - o[1][1]) for o in tag.outlines)
    assert area == pytest.approx(black * 10.0**2)


# What cannot be printed


@pytest.mark.parametrize(
    ("tags", "paper", "phrases"),
    [
        (
            "landmarks:\n  big: {tags: [4], at: [0, 0, 0], size: 0.2}\n",
            "a4",
            ["5:16: tag 4 is 250 mm wide", "use --paper a3 [paper-too-small]"],
        ),
        (
            "landmarks:\n  big: {tags: [4], at: [0, 0, 0], size: 0.17}\n",
            "a4",
            ["5:16: tag 4 is 212.5 mm wide", "use --paper letter [paper-too-small]"],
        ),
        (
            "targets:\n  huge: {tags: [3, 4], at: [0, 0, 0], size: 0.3}\n",
            "a3",
            ["5:17: tag 3 is 375 mm wide", "5:20: tag 4 is 375 mm wide", "[paper-too-small]"],
        ),
        (
            "landmarks:\n  a: {tags: [4], at: [0, 0, 0]}\n  b: {tags: [4], at: [1, 0, 0]}\n",
            "a4",
            ["6:14: tag 4 belongs to 'a' already", "[duplicate-tag]"],
        ),
    ],
)
def test_unprintable_tags_are_reported_with_locations(
    tags: str, paper: str, phrases: list[str], world: World
) -> None:
    path = world(tags)
    with pytest.raises(InputError) as caught:
        pages(path, paper, Registry())
    message = str(caught.value).replace(f"{path}:", "")
    assert [words for words in phrases if words not in message] == []


def test_a_world_without_tags_is_refused(world: World) -> None:
    path = world("")
    with pytest.raises(InputError) as caught:
        main([str(path)])
    assert caught.value.code == "no-tags"


@pytest.mark.parametrize(
    ("out", "code"), [("tags.png", "invalid-argument"), ("nowhere/tags.pdf", "unwritable-file")]
)
def test_a_file_that_cannot_be_written_is_refused(
    out: str, code: str, world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError) as caught:
        main([str(world(TAGS)), "--out", out])
    assert str(caught.value).startswith(f"--out {out}: ")
    assert caught.value.code == code


def test_without_a_name_the_file_is_called_after_the_world(
    world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([str(world(TAGS))]) == 0
    assert (tmp_path / "lab-tags.pdf").read_bytes().startswith(b"%PDF-1.4\n")
    assert capsys.readouterr().out == "4 tags on a4: lab-tags.pdf\n"


# Constants that are written down elsewhere too


def test_the_size_is_the_default_of_worlds() -> None:
    sheet = schemas.load("world")["$defs"]["sheet"]["properties"]
    assert sheet["size"]["default"] == TAG_SIZE


def test_a_rectangle_goes_round_anticlockwise() -> None:
    assert rectangle((0, 0), 2, 1) == ((0, 0), (2, 0), (2, 1), (0, 1))


@pytest.mark.parametrize(("value", "text"), [(1e-9, "0"), (-1e-9, "0"), (10.0, "10"), (0.1, "0.1")])
def test_a_number_is_written_without_exponent_or_idle_noughts(value: float, text: str) -> None:
    assert coordinate(value) == text


# The plan


def test_the_plan_shows_each_tag_to_scale(world: World) -> None:
    plan, table = plan_pages(world(TAGS), "a4", Registry())
    assert (plan.width, plan.height) == PAPERS["a4"]
    texts = [mark for mark in plan.marks if isinstance(mark, Text)]
    assert any("1:25" in text.content for text in texts)
    corner, wall, target = (
        next(text.at for text in texts if text.content.startswith(start))
        for start in ("0, 1 (", "17 (", "586 (")
    )
    assert wall[1] - target[1] == pytest.approx(
        3000 / 25, abs=2
    )  # mm, 3 m along y; labels of larger tags are lower
    assert corner[1] - target[1] == pytest.approx(2400 / 25, abs=5)
    cells = [mark.content for mark in table.marks if isinstance(mark, Text)]
    assert {"4.808", "3.453"} <= set(cells)  # from A and B to the corner, m


@pytest.mark.parametrize(
    ("turns", "way"),
    [
        ("yaw_deg: 0", (0, 1)),
        ("yaw_deg: 90", (-1, 0)),
        ("roll_deg: 180", (0, -1)),  # on the ceiling
        ("roll_deg: 180, yaw_deg: 90", (1, 0)),
        ("pitch_deg: 180", (0, 1)),
        ("roll_deg: 90, yaw_deg: 45", (0, 0)),  # upright
    ],
)
def test_the_line_of_a_tag_on_the_plan_points_up(
    turns: str, way: tuple[int, int], world: World
) -> None:
    path = world(f"landmarks:\n  sheet: {{tags: [0], at: [1, 1, 2], {turns}, size: 0.1}}\n")
    plan, table = plan_pages(path, "a4", Registry())
    black = [mark for mark in plan.marks if isinstance(mark, Fill) and mark.gray == 0]
    square, _, line = (np.array(mark.outlines[0]) for mark in black[-4:-1])  # then the bar
    ends = line[1:3].mean(axis=0) - line[[0, 3]].mean(axis=0)
    assert ends == pytest.approx(100 / 25 * np.array(way), abs=1e-6)  # mm, at 1:25
    assert square.mean(axis=0) == pytest.approx(line[[0, 3]].mean(axis=0))
    angles = [float(word.split(": ")[1]) for word in turns.split(", ")]
    cells = [mark.content for mark in table.marks if isinstance(mark, Text)]
    assert all(any(f"{angle:g}°" in cell for cell in cells) for angle in angles)


def test_a_long_table_continues_on_further_pages(world: World) -> None:
    lines = [f"  t{i}: {{tags: [{i}], at: [{i % 10 / 5 - 1}, {i // 10 / 5 - 1}, 0], size: 0.05}}"
             for i in range(60)]  # fmt: skip
    pages_ = plan_pages(world("landmarks:\n" + "\n".join(lines) + "\n"), "a4", Registry())
    assert len(pages_) == 3
    for page in pages_[1:]:
        tops = [mark.at[1] for mark in page.marks if isinstance(mark, Text)]
        assert min(tops) > 10


def test_a_plan_that_is_too_large_is_an_error(world: World) -> None:
    path = world(TAGS)
    path.write_text(path.read_text(encoding="utf-8").replace("[2, 2, 2]", "[900, 2, 2]"))
    with pytest.raises(InputError, match="too large for a plan"):
        plan_pages(path, "a4", Registry())


def test_the_command_writes_a_plan(world: World, tmp_path: Path) -> None:
    out = tmp_path / "plan.pdf"
    assert main([str(world(TAGS)), "--plan", "-o", str(out)]) == 0
    assert out.read_bytes().count(b"/Type /Page ") == 2
