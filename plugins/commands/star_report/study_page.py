"""The results of a study: its page, tables, statistics and figures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Final, NamedTuple

from star_core.commands import replace_file
from star_core.toolkit import ReportTable
from star_report.comparison import Result
from star_report.drawing import STYLE, WIDTH, Group, figure
from star_report.labels import file_name, label, made
from star_report.sheet import footer, sheet
from star_report.study import Study, read
from star_report.tables import as_csv, html, latex, markdown, tables

MAX_ROWS: Final = 60  # of a figure; of more conditions it has the levels of each factor
SAVE: Final = """<script>
const style = "<style>" + document.getElementById("marks").textContent + "</style>";
for (const button of document.querySelectorAll("button[data-name]")) button.onclick = () => {
  const svg = button.closest("section").querySelector("svg").outerHTML.replace(">", ">" + style);
  const sized = svg.replace(/="([0-9.]+)%"/g, (_, share) => `="${share * WIDTH / 100}"`);
  const link = document.createElement("a");
  link.href = "data:image/svg+xml," + encodeURIComponent(sized);
  link.download = button.dataset.name + ".svg";
  link.click();
};
document.body.dataset.begun = document.body.dataset.ready = "true";
</script>""".replace("WIDTH", str(WIDTH))


class Report(NamedTuple):
    """What is reported of a study.

    Attributes:
        study: Its runs.
        tables: For people.
        statistics: What is in them, by the name of the table.
        figures: Rows of the figure of each measure that varies.
        made: How the study was made, by names.
    """

    study: Study
    tables: Sequence[ReportTable]
    statistics: Mapping[str, Sequence[Result]]
    figures: Mapping[str, Sequence[Group]]
    made: Mapping[str, str]


def report(folder: Path) -> Report:
    """Return the report of the study in a folder.

    Raises:
        InputError: The folder holds no study's table.
    """
    study = read(folder)
    built, statistics = tables(study)
    figures = dict(_figures(study, statistics["condition"], statistics["marginal mean"]))
    return Report(study, built, statistics, figures, made(study.about, _rows(study)))


def write_tables(of: Report, folder: Path) -> None:
    """Write tables, statistics and figures of a study into its folder."""
    made_by = {name: " ".join(text.split()) for name, text in of.made.items() if text}
    lines = [f"# {of.study.name}\n\n{summary(of.study)}\n"]
    lines += [f"## {table.title}\n\n{markdown(table)}" for table in of.tables]
    lines.append("## How this was made\n\n" + "".join(f"- {n}: {t}\n" for n, t in made_by.items()))
    replace_file(folder / "results.md", "\n".join(lines))
    comments = "".join(f"% {name}: {text}\n" for name, text in made_by.items())
    texts = "\n".join(latex(table) for table in of.tables if table.measures)
    replace_file(folder / "results.tex", f"% \\usepackage{{booktabs}}\n{comments}\n{texts}")
    replace_file(folder / "statistics.csv", as_csv(of.study, of.statistics))
    for measure, groups in of.figures.items():
        name = f"figure-{file_name(measure)}.svg"
        replace_file(folder / name, figure(label(measure), groups, WIDTH))


def page(of: Report) -> str:
    """Return the report of a study as HTML."""
    sections = [
        f"<style id=marks>{STYLE}</style><h1>{escape(of.study.name)}</h1>"
        f"<p class=quiet>{escape(summary(of.study))}</p>",
        *map(html, of.tables[:1]),
        *(_section(measure, groups) for measure, groups in of.figures.items()),
        *map(html, of.tables[1:]),
        footer(of.made),
    ]
    return sheet(of.study.name, sections, SAVE)


def summary(study: Study) -> str:
    """Return how many runs and conditions a study has, and what is the same in all."""
    number = len(study.table["seed"])
    planned = study.about.get("runs")
    runs = f"{number} of {planned}" if isinstance(planned, int) and planned > number else number
    conditions = len(study.conditions)
    many = "condition" if conditions == 1 else "conditions"
    constant = [f"; {name}: {level}" for name, level in study.constant.items()]
    return f"{runs} runs, {conditions} {many}{''.join(constant)}."


def _rows(study: Study) -> dict[str, str]:
    """Return seeds and plugins of a study."""
    plugins = study.about.get("plugins")
    return {
        "seeds": ", ".join(_ranges(sorted(set(study.table["seed"])))),
        "plugins": ", ".join(map(str, plugins)) if isinstance(plugins, list) else "",
    }


def _ranges(numbers: Sequence[int]) -> Iterator[str]:
    """Yield ranges of increasing numbers.

    >>> list(_ranges([0, 1, 2, 5, 7, 8]))
    ['0 to 2', '5', '7 to 8']
    """
    first = 0
    for i, number in enumerate(numbers):
        if i + 1 == len(numbers) or numbers[i + 1] != number + 1:
            yield f"{numbers[first]} to {number}" if i > first else f"{number}"
            first = i + 1


def _figures(
    study: Study, conditions: Sequence[Result], marginal: Sequence[Result]
) -> Iterator[tuple[str, list[Group]]]:
    """Yield each measure that is not the same in all runs, with the rows of its figure."""
    for measure in study.varied:
        if measure not in study.shares:
            results = conditions if len(study.conditions) <= MAX_ROWS else marginal
            yield (
                measure,
                [_group(study, result) for result in results if result.measure == measure][
                    :MAX_ROWS
                ],
            )


def _group(study: Study, result: Result) -> Group:
    """Return the row of a figure: the runs at some levels."""
    chosen = [
        row
        for levels, rows in study.conditions.items()
        if result.levels.items() <= dict(zip(study.names, levels, strict=True)).items()
        for row in rows
    ]
    measured = [row for row in chosen if study.value(row, result.measure) is not None]
    levels = result.levels
    named = ", ".join(f"{name}: {level}" for name, level in levels.items())
    return Group(
        label=named if len(levels) > 1 or len(study.names) > 1 else next(iter(levels.values())),
        values=[float(value) for value in study.values(measured, result.measure)],
        seeds=[_run(study, row) for row in measured],
        mean=result.mean,
    )


def _run(study: Study, row: int) -> str:
    mission = f"{study.table['mission'][row]}, " if "mission" in study.names else ""
    return f"{mission}seed {study.table['seed'][row]}"


def _section(measure: str, groups: Sequence[Group]) -> str:
    """Return the section of a figure."""
    name = label(measure)
    key = f"<code>{escape(measure)}</code>" if measure != name else ""
    return (
        f"<section><h2>{escape(name)}{key}<button class=save data-name={file_name(measure)} "
        f'title="Save this figure as SVG">SVG</button></h2>{figure(name, groups)}</section>'
    )
