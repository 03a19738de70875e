"""Figures: the same bytes every time, and pixels that are counted as the experiment counts them."""

from __future__ import annotations

import dataclasses
import struct

import numpy as np
import pytest

from mapgraft.experiments.andersone2021.raster import Raster, left_masks, raster_of
from mapgraft.experiments.andersone2021.settings import PAPER, STRATEGIES
from mapgraft.experiments.andersone2021.telling.as_published import ways_shown
from mapgraft.experiments.andersone2021.telling.charts import histograms, resolution_figure
from mapgraft.experiments.andersone2021.telling.curve_charts import areas_figure, curves_figures
from mapgraft.experiments.andersone2021.telling.detection import curves
from mapgraft.experiments.andersone2021.telling.examples import remake, right_example, wrong_example
from mapgraft.experiments.andersone2021.telling.pictures import map_figures, shades


def test_every_figure_is_a_png_of_a_sensible_size(files):
    names = [name for name in files if name.startswith("figures/")]
    assert [name.removeprefix("figures/").removesuffix(".png") for name in names] == [
        "figure5",
        "figure7",
        "figure8",
        "figure9",
        "figure6",
        "figure6_all",
        "roc",
        "roc_by_resolution",
        "areas",
        "resolution",
        "costs",
    ]
    for name in names:
        width, height = struct.unpack(">II", files[name][16:24])
        assert 900 <= width <= 2000 and 400 <= height <= 2200, name
        assert b"tEXt" not in files[name][:400]  # neither date nor software


def test_figures_are_the_same_every_time(experiment, laboratory, files):
    found = curves(experiment)
    again = [
        *map_figures(experiment, laboratory),
        *curves_figures(experiment, found),
        areas_figure(experiment, found),
        resolution_figure(experiment, found),
    ]
    for figure in again:
        assert figure.png == files[f"figures/{figure.name}.png"], figure.name


def test_the_example_is_the_merge_that_was_measured(experiment, laboratory):
    example = wrong_example(experiment)
    remade = remake(laboratory, example)
    never = raster_of(remade.map_type, remade.graft.never_merged().fused())
    for strategy in STRATEGIES:
        left = example.merge.by[strategy].leftovers
        masks = left_masks(*raster_of(remade.map_type, remade.reverted(strategy)).joined(never))
        counts = {name: int(mask.sum()) for name, mask in masks.items()}
        assert counts["lost"] == left.lost and counts["alien"] == left.alien and counts["changed"] == left.changed
        assert sum(counts.values()) == left.touched
        assert np.stack(list(masks.values())).sum(axis=0).max() <= 1  # no cell under two names
    assert example.merge.by["single_map"].leftovers.touched > 0


def test_examples_are_chosen_by_what_is_told(made, experiment_of):
    merges = [
        made(True, 0),
        made(False, 1, two=(0.96, 9.0), combination=PAPER[1]),
        made(False, 2, two=(0.97, 5.0), combination=PAPER[1]),
        made(False, 3, two=(0.99, 50.0)),
    ]
    chosen = wrong_example(experiment_of(merges))
    assert chosen.merge.name == "0.07-0.1/1" and "of 2 wrong merges" in chosen.why
    chosen = wrong_example(experiment_of([merges[0], merges[3]]))
    assert chosen.merge.number == 3 and "the only wrong merge" in chosen.why
    chosen = wrong_example(experiment_of([made(False, 4, two=(0.92, 1.0)), made(False, 5, two=(0.94, 1.0))]))
    assert chosen.merge.number == 5 and "no wrong merge passed" in chosen.why
    assert wrong_example(experiment_of(merges[:1])) is None
    assert right_example(experiment_of(merges)).merge.number == 0
    assert right_example(experiment_of(merges[1:])) is None


def test_what_there_is_not_is_said(made, experiment_of, laboratory):
    experiment = experiment_of([made(False, 0)])
    nothing = map_figures(dataclasses.replace(experiment, merges=[]), laboratory)
    assert [(figure.name, figure.png) for figure in nothing] == [(f"figure{n}", None) for n in (5, 7, 8, 9)]
    assert all("no such merge" in figure.caption for figure in nothing)
    figures = {figure.name: figure for figure in _charts(experiment)}
    assert figures["roc"].png is None and "too few merges" in figures["roc"].caption
    assert figures["areas"].png is None
    assert all(figures[name].png for name in ("figure6", "figure6_all", "resolution"))


def _charts(experiment):
    found = curves(experiment)
    yield from histograms(experiment, found)
    yield from curves_figures(experiment, found)
    yield from (areas_figure(experiment, found), resolution_figure(experiment, found))


@pytest.mark.parametrize(("percent", "shade"), [(0, 1.0), (50, 0.8), (100, 0.0), (-1, 0.8)])
def test_the_less_is_known_the_greyer(percent, shade):
    pixels = shades(Raster(np.full((2, 3), percent, np.int8), (0, 0), (0.0, 0.0), 0.1))
    assert pixels.shape == (2, 3, 4)
    assert pixels[..., :3] == pytest.approx(shade) and (pixels[..., 3] == 1.0).all()


def test_the_ledger_has_panels_of_its_own_unless_its_numbers_are_those_of_two_maps(made, experiment_of):
    merges = [made(right, n, two=(0.9 + 0.01 * n, 1.0 + n)) for n, right in enumerate((True, True, False, False))]
    assert list(ways_shown(experiment_of(merges)).values()) == ["1M", "2M and ledger"]
    assert "those of two maps" in histograms(experiment_of(merges), [])[0].caption
    kept = merges[0].by["ledger"]
    other = dataclasses.replace(kept, end={**kept.end, "distance": 1.5})
    merges[0] = dataclasses.replace(merges[0], by={**merges[0].by, "ledger": other})
    assert list(ways_shown(experiment_of(merges)).values()) == ["1M", "2M", "ledger"]
    assert "those of two maps" not in histograms(experiment_of(merges), [])[0].caption
