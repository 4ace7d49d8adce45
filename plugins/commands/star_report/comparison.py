"""Estimates of a study: by condition, differences, marginal means, interactions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from star_report.estimates import Estimate, holm, means, median, p_value
from star_report.study import Block, Cells, Levels, Study


class Result(NamedTuple):
    """A row of the statistics of a study.

    Attributes:
        levels: Of the factors that are named; it is an average over the others.
        measure: Path into a summary, or ``outcome`` for the share of completed runs.
        mean: Mean, or mean difference, with its interval.
        median: Median of the same values; None for differences.
        baseline: Of differences: the levels with which these are compared.
        p: p-value of a difference; None if there are too few.
        p_holm: The same, corrected for all comparisons of its table.
    """

    levels: Mapping[str, str]
    measure: str
    mean: Estimate
    median: Estimate | None = None
    baseline: Mapping[str, str] = {}
    p: float | None = None
    p_holm: float | None = None


class _Sample(NamedTuple):
    levels: Mapping[str, str]
    measure: str
    values: Sequence[float]
    baseline: Mapping[str, str] = {}


def by_condition(study: Study) -> list[Result]:
    """Return the mean and the median of each measure in each condition."""
    return _summed_up(
        study,
        (
            _Sample(
                dict(zip(study.names, levels, strict=True)), measure, study.values(rows, measure)
            )
            for measure in study.measures
            for levels, rows in study.conditions.items()
        ),
    )


def differences(study: Study) -> list[Result]:
    """Return mean differences to the baseline, of pairs of runs with the same seed."""
    return _compared(study, _differences(study))


def _differences(study: Study) -> Iterator[_Sample]:
    for measure in study.varied:
        names, cells = study.cells(measure)
        for levels, cell in cells.items():
            base = study.baseline_of(levels, names, cells)
            if base is not None:
                before = cells[base]
                pairs = [cell[block] - before[block] for block in cell if block in before]
                with_names = [dict(zip(names, of, strict=True)) for of in (levels, base)]
                yield _Sample(with_names[0], measure, pairs, with_names[1])


def marginal_means(study: Study) -> list[Result]:
    """Return the mean of each level of each factor over the others, if several vary.

    The levels of a factor are averaged over the same combinations of the others: those at which all
    of its levels were flown. In each block of runs the average is over all of these combinations,
    and the interval is that over blocks, whose runs share their seed; if all averages are equal, it
    is that of the runs.
    """
    return _summed_up(study, _marginal_means(study))


def _marginal_means(study: Study) -> Iterator[_Sample]:
    for measure in study.varied:
        names, cells = study.cells(measure)
        for name in names if len(names) > 1 else ():
            levels = study.levels(name)
            others = _others(cells, [names.index(name)], [(level,) for level in levels])
            for level in levels if others else ():
                at = [_with(other, [names.index(name)], (level,)) for other in others]
                blocks = _common(cells, at)
                averages = [float(np.mean([cells[cell][b] for cell in at])) for b in blocks]
                runs = [cells[cell][block] for cell in at for block in blocks]
                yield _Sample({name: level}, measure, averages if len(set(averages)) > 1 else runs)


def interactions(study: Study) -> list[Result]:
    """Return how much the difference between two levels of a factor depends on another factor.

    It is the difference of differences: of a level of one factor to its reference, at a level of
    the other, minus that at the reference of the other. References are the levels of the
    baseline, or the first. It is averaged over the combinations of further factors.
    """
    return _compared(study, _interactions(study))


def _interactions(study: Study) -> Iterator[_Sample]:
    for measure in study.varied:
        names, cells = study.cells(measure)
        for first, second in combinations(names, 2):
            at = [names.index(first), names.index(second)]
            lists = [study.levels(first), study.levels(second)]
            base = [
                study.baseline.get(n, of[0]) for n, of in zip((first, second), lists, strict=True)
            ]
            for level in lists[0]:
                for other in lists[1]:
                    if level == base[0] or other == base[1]:
                        continue
                    corners = [(x, y) for y in (other, base[1]) for x in (level, base[0])]
                    values = _contrasts(cells, at, corners)
                    reference = {first: base[0], second: base[1]}
                    if values is not None:
                        yield _Sample({first: level, second: other}, measure, values, reference)


def _contrasts(cells: Cells, at: Sequence[int], corners: Sequence[Levels]) -> list[float] | None:
    """Return the difference of differences of each block; None if a corner was not flown."""
    signs = (1, -1, -1, 1)
    others = _others(cells, at, corners)
    if not others:
        return None
    groups = [[_with(other, at, corner) for other in others] for corner in corners]
    return [
        float(sum(sign * np.mean([cells[cell][block] for cell in group])
                  for sign, group in zip(signs, groups, strict=True)))
        for block in _common(cells, [cell for group in groups for cell in group])
    ]  # fmt: skip


def _others(cells: Cells, at: Sequence[int], corners: Sequence[Levels]) -> list[Levels]:
    """Return cells, one for each combination of the factors not `at`, flown at all corners."""
    by_others: dict[Levels, Levels] = {}
    for levels in cells:
        by_others.setdefault(tuple(x for i, x in enumerate(levels) if i not in at), levels)
    return [
        levels
        for levels in by_others.values()
        if all(_with(levels, at, corner) in cells for corner in corners)
    ]


def _with(levels: Levels, at: Sequence[int], corner: Levels) -> Levels:
    changed = dict(zip(at, corner, strict=True))
    return tuple(changed.get(i, level) for i, level in enumerate(levels))


def _common(cells: Cells, at: Sequence[Levels]) -> list[Block]:
    """Return the blocks that all of some cells have."""
    return [block for block in cells[at[0]] if all(block in cells[cell] for cell in at)]


def _summed_up(study: Study, samples: Iterable[_Sample]) -> list[Result]:
    measured = [sample for sample in samples if sample.values]
    estimates = means([sample.values for sample in measured])
    return [
        Result(sample.levels, sample.measure, _bounded(study, sample, mean), median(sample.values))
        for sample, mean in zip(measured, estimates, strict=True)
    ]


def _compared(study: Study, samples: Iterable[_Sample]) -> list[Result]:
    measured = [sample for sample in samples if sample.values]
    estimates = means([sample.values for sample in measured], signed=True)
    p_values = [p_value(sample.values) for sample in measured]
    return [
        Result(
            sample.levels, sample.measure, _bounded(study, sample, mean), None, sample.baseline, *p
        )
        for sample, mean, *p in zip(measured, estimates, p_values, holm(p_values), strict=True)
    ]


def _bounded(study: Study, sample: _Sample, mean: Estimate) -> Estimate:
    """Return the mean of shares, or of their differences, with an interval up to 1."""
    if not (mean.method and sample.measure in study.shares):
        return mean
    return mean._replace(low=max(-1.0, mean.low), high=min(1.0, mean.high))
