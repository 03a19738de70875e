"""Everything that comes with mapgraft is tried as ``mapgraft plugins check`` tries it, and what is not tried is known.

One example of each law, the simplest one, shows that it can be driven and is not broken at once; many examples are
tried beside the plugins' own tests.
"""

from __future__ import annotations

from collections import defaultdict
from typing import Final

import pytest

from mapgraft.plugins import OWN, load_plugins
from mapgraft.testing.checking import cases_of

PLUGINS = load_plugins()
ENTRY_POINTS = sorted(
    {offered.origin.plugin for offered in PLUGINS.offered.values() if offered.origin.distribution == OWN}
)
NO_LAWS: Final = "there are no laws of that kind, or it needs a value that only a configuration gives"
STREAM: Final = (
    "an_updated_tracker_equals_a_fresh_one",
    "a_changed_donor_is_measured",
)  # nothing is heard in one example
PARTED: Final = ("joining_is_the_inverse_of_cutting", "a_joined_layer_lives_on", "damaged_parts_are_refused")
PREVIEWED: Final = "a_preview_shows_the_map"
SEEN_ONCE: Final = "what_stood_stands_on"  # the simplest scene has one observation
UNTRIED: Final[dict[str, dict[str, set[str]]]] = {
    "floor_plan": {
        NO_LAWS: {"format plan_dxf", "format plan_image", "format plan_svg"},
        "concerns_are_honest": {"metric plan_agreement", "metric plan_deviations", "metric plan_posterior"},
        "placing_makes_no_looks": {"map type floor_plan"},  # nobody has seen a plan
        **{law: {"map type floor_plan"} for law in (*PARTED, PREVIEWED)},  # it is small, and sent once
        "converting_makes_no_looks": {
            "conversion floor_plan_to_line_segments", "conversion floor_plan_to_occupancy_grid"
        },
        "the_source_says_how_it_is_read": {
            "conversion floor_plan_to_line_segments", "conversion floor_plan_to_occupancy_grid"
        },  # its walls are walls
        SEEN_ONCE: {"conversion floor_plan_to_line_segments", "conversion floor_plan_to_occupancy_grid"},
    },
    "line_segments": {
        NO_LAWS: {"format lines_geojson"},
        PREVIEWED: {"map type line_segments"},  # its layers are as small as a preview would be
        "concerns_are_honest": {
            f"metric line_{name}" for name in ("contradiction", "explained", "news", "posterior", "residual")
        },
        **{law: {"metric line_news"} for law in STREAM},
        SEEN_ONCE: {"conversion line_segments_to_occupancy_grid", "conversion occupancy_grid_to_line_segments"},
    },
    "occupancy_grid": {
        NO_LAWS: {"format image", "format map_server"},
        "concerns_are_honest": {
            f"metric {name}"
            for name in (
                "bayes_factor", "contradiction", "distance", "kappa", "margin", "news", "paths", "posterior", "rays",
                "recall", "similarity",
            )
        },
        **{law: {"metric news"} for law in STREAM},
        "the_prior_is_scored": {"matcher carpin"},
    },
    "point_cloud": {
        NO_LAWS: {"decoder foxglove_point_cloud", "decoder point_cloud2", "format cloud_file"},
        "concerns_are_honest": {"metric cloud_contradiction", "metric cloud_overlap"},
        SEEN_ONCE: {"conversion occupancy_grid_to_point_cloud", "conversion point_cloud_to_occupancy_grid"},
    },
    "standard": {
        NO_LAWS: {"policy at", "policy topic"},
        "concerns_are_honest": {"metric rendezvous"},  # nobody is seen in one example
        "foreign_maps_are_refused": {"matcher known_pose"},
        "the_prior_is_scored": {"matcher known_pose"},
    },
}  # fmt: skip
EXCUSED: Final = {
    "matcher carpin": "the_best_comes_first",
    "metric bayes_factor": "measurements_are_well_formed",
}


def test_every_entry_point_of_ours_is_tried() -> None:
    assert set(ENTRY_POINTS) == set(UNTRIED)
    assert [broken for broken in PLUGINS.broken if broken.origin.distribution == OWN] == []


@pytest.mark.parametrize("plugin", ENTRY_POINTS)
def test_ours_keep_the_laws_and_what_is_not_tried_is_known(plugin: str) -> None:
    untried: defaultdict[str, set[str]] = defaultdict(set)
    broken, excused, titles = {}, set(), []
    for case in cases_of(PLUGINS, plugin, examples=1):
        thing = case.title.partition(",")[0]
        titles.append(thing)
        if case.subject is None and "pip install" not in case.reason:  # else an extra is not installed here
            untried[NO_LAWS].add(thing)
        for outcome in case.outcomes():
            if outcome.status == "not tried":
                untried[outcome.law.name].add(thing)
            elif outcome.status == "expected failure":
                excused.add((thing, outcome.law.name))
            elif outcome.status != "kept":
                broken[case.title, outcome.law.name] = outcome.sentence
    assert broken == {}
    assert untried == UNTRIED[plugin]
    assert excused == {item for item in EXCUSED.items() if item[0] in titles}
    things = {f"{kind} {name}" for (kind, name), o in PLUGINS.offered.items() if o.origin.plugin == plugin}
    assert set(titles) == {f"plugin {plugin}", *things}
