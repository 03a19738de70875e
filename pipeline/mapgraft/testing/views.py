"""The laws of views: what matchers, metrics and people look at."""

from __future__ import annotations

import re
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from mapgraft.contracts import Contribution, EmptyMapError, OutputError, PluginError
from mapgraft.testing.content import content_of
from mapgraft.testing.laws import BrokenLawError, Drawing, law, require
from mapgraft.testing.scenes import describe, moved
from mapgraft.testing.supply import Supply, contributed, layer_of, require_moved, require_same_map, scene_of

if TYPE_CHECKING:
    from mapgraft.outputs.messages import MessageEncoder

_TOPIC = re.compile(r"[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)*")
_STAMP_NS = 1_600_000_000_000_000_000


@cache
def _encoder() -> MessageEncoder:
    """One for all examples: it reads the definitions of all messages."""
    from mapgraft.outputs.messages import MessageEncoder

    return MessageEncoder()


class ViewLaws(Supply):
    """Looking at layers: pure, repeatable, incremental as fresh, and shown to others."""

    @law("looking writes nothing: neither a layer, nor a contribution, nor a map")
    def test_looking_writes_nothing(self, drawing: Drawing) -> None:
        map_type, scene = self.make_map_type(), scene_of(self, drawing)
        own = layer_of(map_type, scene.own)
        given = contributed(self, map_type, own, scene, drawing.draw(self.moves()))
        before = (map_type.encode(own), map_type.encode(given.layer))
        map_ = map_type.view(own, (given,))
        seen = self.fingerprint(map_type, map_)
        map_type.known_region(map_), map_type.region(own), map_type.metadata(own), map_type.view(own)
        map_type.structure(map_, map_)
        require((map_type.encode(own), map_type.encode(given.layer)) == before, "a layer changed when it was looked at")
        require(self.fingerprint(map_type, map_) == seen, "a map changed when it was looked at")

    @law("equal layers make equal maps")
    def test_views_are_deterministic(self, drawing: Drawing) -> None:
        scene, T = scene_of(self, drawing), drawing.draw(self.moves())
        seen = []
        for _ in range(2):
            map_type = self.make_map_type()
            own = layer_of(map_type, scene.own)
            seen.append(self.fingerprint(map_type, map_type.view(own, (contributed(self, map_type, own, scene, T),))))
        require(seen[0] == seen[1], "two instances with equal layers show different maps")

    @law("a view updated where something has changed equals a fresh one, and earlier views stay as they were")
    def test_an_updated_view_equals_a_fresh_one(self, drawing: Drawing) -> None:
        map_type, scene = self.make_map_type(), scene_of(self, drawing)
        own = map_type.new_layer()
        map_type.integrate(own, scene.own[0])
        first = contributed(self, map_type, own, scene, drawing.draw(self.moves()))
        second = contributed(self, map_type, own, scene, drawing.draw(self.moves()), "another")
        seen = map_type.view(own)
        old = (seen, self.fingerprint(map_type, seen))
        changes: list[tuple[str, tuple[Contribution, ...]]] = [
            ("a contribution came", (first,)),
            ("a second one came", (first, second)),
            ("the first was taken out", (second,)),
            ("all were taken out", ()),
        ]
        standing: tuple[Contribution, ...] = ()
        for n, (what, after) in enumerate(changes):
            changed = [c.region for c in (*standing, *after) if (c in standing) != (c in after)]
            if n < len(scene.own):
                changed.append(map_type.integrate(own, scene.own[n]))
            touched = changed[0]
            for region in changed[1:]:
                touched = touched.union(region)
            seen, standing = map_type.view(own, after, seen, touched), after
            clause = f"when {what}, the updated view is not a fresh one"
            require_same_map(self, map_type, seen, map_type.view(own, after), clause)
        require(self.fingerprint(map_type, old[0]) == old[1], "a view changed after it was made")

    @law("known_region has as many units as the map says it knows")
    def test_the_map_knows_what_it_says(self, drawing: Drawing) -> None:
        map_type, scene = self.make_map_type(), scene_of(self, drawing)
        own = layer_of(map_type, scene.own)
        given = contributed(self, map_type, own, scene, drawing.draw(self.moves()))
        for map_ in (map_type.view(own), map_type.view(own, (given,)), map_type.view(None, (given,))):
            known, said = len(map_type.known_region(map_)), map_.known()
            require(known == said, f"it says that it knows {said} units, known_region has {known}")

    @law("structure gives finite points in metres, and within another map only some of them")
    def test_structure_lies_in_the_map(self, drawing: Drawing) -> None:
        map_type, scene = self.make_map_type(), scene_of(self, drawing)
        map_, other = (map_type.view(layer_of(map_type, seen)) for seen in (scene.own, scene.donor))
        points = map_type.structure(map_)
        shape = f"{points.dtype} {points.shape}"
        require(points.ndim == 2 and points.shape[1] in (2, 3), f"it has to be (n, 2) or (n, 3), found {shape}")
        require(points.dtype == np.float64 and bool(np.isfinite(points).all()), f"not all finite float64: {shape}")
        inside = map_type.structure(map_, other)
        fewer = {tuple(p) for p in inside.tolist()} <= {tuple(p) for p in points.tolist()}
        require(fewer, "within another map there are points that the map alone does not have")
        all_of_it = map_type.structure(map_, map_)
        require(len(all_of_it) == len(points), f"within itself {len(all_of_it)} of its {len(points)} points are left")
        nothing = map_type.structure(map_, map_type.view(map_type.new_layer()))
        require(len(nothing) == 0, f"within an empty map {len(nothing)} points are left")

    @law("a robot whose frame lies elsewhere makes the same map there", vacuous="nothing stands in any of the maps")
    def test_a_moved_robot_makes_a_moved_map(self, drawing: Drawing) -> None:
        map_type, scene, T = self.make_map_type(), scene_of(self, drawing), drawing.draw(self.moves())
        drawing.note(f"moved by {describe(T)}")
        here = map_type.structure(map_type.view(layer_of(map_type, scene.own)))
        elsewhere = self.make_map_type()
        there = map_type.structure(elsewhere.view(layer_of(elsewhere, (moved(o, T) for o in scene.own))))
        if len(here) < 3:
            return
        drawing.reached()
        require_moved(T.apply(here), there, self.tolerance_m(map_type), self.moved_share, self.moved_share)

    @law("messages are ROS 2 messages of known types, with topics that ROS takes")
    def test_messages_encode(self, drawing: Drawing) -> None:
        map_type, scene, encoder = self.make_map_type(), scene_of(self, drawing), _encoder()
        for layer in (layer_of(map_type, scene.own), map_type.new_layer()):
            for message in map_type.messages(map_type.view(layer)):
                legal = _TOPIC.fullmatch(message.suffix)
                require(legal, f"{message.suffix!r} cannot end the name of a topic: use letters, digits and '_'")
                try:
                    once = encoder.encode(message.message_type, message.fields, _STAMP_NS, "map")
                except (PluginError, OutputError) as error:
                    raise BrokenLawError(str(error)) from error
                again = encoder.encode(message.message_type, message.fields, _STAMP_NS, "map")
                require(once == again, f"{message.message_type} encodes differently the second time")

    @law("files are bytes under names that start with the stem; an empty map has none or raises EmptyMapError")
    def test_files_start_with_their_stem(self, drawing: Drawing) -> None:
        map_type, scene = self.make_map_type(), scene_of(self, drawing)
        for layer in (layer_of(map_type, scene.own), map_type.new_layer()):
            map_ = map_type.view(layer)
            try:
                files = dict(map_type.files(map_, "a_stem"))
            except EmptyMapError:
                require(map_.known() == 0, f"it raises EmptyMapError although {map_.known()} units are known")
                continue
            wrong = [name for name in files if not name.startswith("a_stem.") or "/" in name]
            require(not wrong, f"the file names {wrong} do not start with 'a_stem.'")
            kinds = [name for name, data in files.items() if not isinstance(data, bytes)]
            require(not kinds, f"the content of {kinds} is not bytes")
            require(content_of(files) == content_of(dict(map_type.files(map_, "a_stem"))), "written twice, it differs")
