"""Judging matchers, acceptance and verification on recordings whose poses are trusted.

``statistics``, ``scored``, ``summary`` and ``tables`` know nothing of recordings: they count whatever was scored.
"""

from mapgraft.evaluation.bench import Bench, Judged, Settings
from mapgraft.evaluation.building import Pair, Side, build
from mapgraft.evaluation.courses import Course, load_courses
from mapgraft.evaluation.document import document
from mapgraft.evaluation.drawing import Drawing, PairPlan, Window, draw_pairs
from mapgraft.evaluation.evaluating import Evaluation, evaluate, evaluate_courses
from mapgraft.evaluation.truth import RIGHT_DEG, RIGHT_M, Error, Truth

__all__ = [
    "RIGHT_DEG",
    "RIGHT_M",
    "Bench",
    "Course",
    "Drawing",
    "Error",
    "Evaluation",
    "Judged",
    "Pair",
    "PairPlan",
    "Settings",
    "Side",
    "Truth",
    "Window",
    "build",
    "document",
    "draw_pairs",
    "evaluate",
    "evaluate_courses",
    "load_courses",
]
