"""Judging matchers and verifiers on recordings whose poses are trusted."""

from mapgraft.evaluation.building import Pair, Side, build
from mapgraft.evaluation.courses import Course, load_courses
from mapgraft.evaluation.drawing import Drawing, PairPlan, Window, draw_pairs
from mapgraft.evaluation.truth import RIGHT_DEG, RIGHT_M, Error, Truth

__all__ = [
    "RIGHT_DEG",
    "RIGHT_M",
    "Course",
    "Drawing",
    "Error",
    "Pair",
    "PairPlan",
    "Side",
    "Truth",
    "Window",
    "build",
    "draw_pairs",
    "load_courses",
]
