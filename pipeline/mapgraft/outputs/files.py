"""The files of a run that people open with other tools: maps, trajectories, transforms, summary."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mapgraft.contracts import Map
from mapgraft.errors import MapError, PluginError
from mapgraft.events import Event, Snapshot
from mapgraft.outputs.asking import Asking
from mapgraft.outputs.names import Names
from mapgraft.outputs.poses import Path
from mapgraft.outputs.staging import Staging, sync
from mapgraft.outputs.standing import Chain, StandingMerge, chains_from, components

_TUM = "{}.{:09d}" + " {:.9f}" * 7
_SIGMAS = ("sigma_x_m", "sigma_y_m", "sigma_z_m", "sigma_roll_rad", "sigma_pitch_rad", "sigma_yaw_rad")
_TRANSFORM_COLUMNS = (
    *("target", "source", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw", "yaw_rad", "scale"),
    *(*_SIGMAS, "merges", "state"),
)


@dataclass(frozen=True, slots=True)
class Component:
    """Robots that standing merges connect. ``name`` is the first robot's; ``map_of`` the robot whose fused map it
    has: the first one that receives, so that the frame of the component's map does not jump."""

    name: str
    robots: tuple[str, ...]
    map_of: str


class Trajectories:
    """The bodies' paths as ``trajectories/<robot>.tum``: stamp (s), x, y, z (m), quaternion x, y, z, w; map frame."""

    def __init__(self, staging: Staging, names: Names) -> None:
        self._staging, self._names = staging, names
        self._files: dict[str, str] = {}
        self._spans: dict[str, list[int]] = {}

    def moved(self, paths: Sequence[Path]) -> None:
        """Append pieces of paths."""
        for path in paths:
            self._count(path)
            lines = [
                _TUM.format(*divmod(stamp, 1_000_000_000), *row)
                for stamp, row in zip(path.stamps_ns.tolist(), path.numbers.tolist(), strict=True)
            ]
            with self._staging.partial(self._file(path.robot)).open("ab") as stream:  # many robots, few descriptors
                stream.write(("\n".join(lines) + "\n").encode())

    def close(self) -> None:
        """All trajectories are on disk when this returns."""
        for name in self._files.values():
            with self._staging.partial(name).open("ab") as stream:
                sync(stream)

    def summary(self, robot: str) -> dict[str, Any]:
        """How many poses there were of a robot, and from when to when."""
        if robot not in self._spans:
            return {"observations": 0}
        count, first_ns, last_ns = self._spans[robot]
        return {"observations": count, "first_stamp_ns": first_ns, "last_stamp_ns": last_ns}

    def _count(self, path: Path) -> None:
        first_ns, last_ns = int(path.stamps_ns[0]), int(path.stamps_ns[-1])
        span = self._spans.setdefault(path.robot, [0, first_ns, last_ns])
        span[0] += len(path.stamps_ns)
        span[2] = last_ns

    def _file(self, robot: str) -> str:
        name = self._files.get(robot)
        if name is None:
            name = self._files[robot] = f"trajectories/{self._names[robot]}.tum"
            self._staging.create(name).close()
        return name


def connected(robots: Iterable[str], merges: Sequence[StandingMerge]) -> list[Component]:
    """The components of two and more robots."""
    receivers = {merge.receiver for merge in merges}
    parts = [part for part in components(robots, merges) if len(part) > 1]
    return [Component(part[0], part, next(robot for robot in part if robot in receivers)) for part in parts]


def map_files(
    snapshots: Mapping[str, Snapshot],
    together: Sequence[Component],
    names: Names,
    unshown: dict[str, str] | None = None,
    asking: Asking | None = None,
) -> dict[str, bytes]:
    """``maps/<robot>.*`` (own) and ``maps/<component>.merged.*`` (fused): name → content.

    ``snapshots`` holds the last one of every robot. A map that knows nothing gives no file. Where ``unshown`` is given,
    a map that its type cannot write is left out, and why goes there by the name of the file.
    """
    asking, out = asking or Asking(), dict[str, bytes]()
    for robot, snapshot in sorted(snapshots.items()):
        if snapshot.own.known():
            out |= _files_of(snapshot, snapshot.own, names[robot], unshown, asking)
    for component in together:
        last = snapshots.get(component.map_of)
        if last is not None and last.fused.known():
            stem = f"{names[component.name]}.merged"
            out |= _files_of(last, last.fused, stem, unshown, asking)
    return out


def transforms_csv(merges: Sequence[StandingMerge]) -> bytes:
    """Every ordered pair of connected robots: T_target_source, its standard deviations, its merges, its state."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_TRANSFORM_COLUMNS)
    for part in components((), merges):
        for target in part:
            chains = chains_from(target, merges)
            writer.writerows(_transform_row(chains[source]) for source in part if source != target)
    return text.getvalue().encode()


class Tally:
    """Counts what happened and remembers the last word on every merge, for the summary."""

    def __init__(self) -> None:
        self._kinds: dict[str, int] = {}
        self._merges: dict[str, Event] = {}

    def happened(self, event: Event) -> None:
        self._kinds[event.kind] = self._kinds.get(event.kind, 0) + 1
        if event.merge_id and (event.kind == "merged" or event.merge_id in self._merges):
            self._merges[event.merge_id] = event

    def summary(self) -> dict[str, Any]:
        """``events``: kind → count; ``merges``: every merge that was made, with its state now and the last reason."""
        return {
            "events": dict(sorted(self._kinds.items())),
            "merges": [
                {
                    "merge_id": merge_id,
                    "receiver": event.receiver,
                    "donor": event.donor,
                    "state": event.state,
                    "reason": event.reason,
                    **_planar(event),
                }
                for merge_id, event in self._merges.items()
            ],
        }


def json_bytes(document: Mapping[str, Any]) -> bytes:
    return (json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode()


def _files_of(
    snapshot: Snapshot, map_: Map, stem: str, unshown: dict[str, str] | None, asking: Asking
) -> dict[str, bytes]:
    map_type = snapshot.map_type
    try:
        return asking.ask(snapshot.robot, map_type, lambda: _in_maps(map_type.files(map_, stem), stem))
    except (MapError, PluginError) as error:  # too large to write, or a stranger's code
        if unshown is None:
            raise
        unshown[stem] = f"the map {stem} could not be written: {error}"
        return {}


def _in_maps(files: Mapping[str, bytes], stem: str) -> dict[str, bytes]:
    for name in files:
        if not name.startswith(stem) or "/" in name:
            raise PluginError(f"a map type gave a file {name!r}: its name must start with {stem!r} and hold no '/'")
    return {f"maps/{name}": content for name, content in files.items()}


def _transform_row(chain: Chain) -> list[object]:
    T, covariance = chain.T_target_source, chain.covariance
    sigmas: list[object] = [""] * 6 if covariance is None else [max(v, 0.0) ** 0.5 for v in covariance.diagonal()]
    return [
        *(chain.target, chain.source, T.x_m, T.y_m, T.z_m, *T.quaternion_xyzw(), T.yaw_rad, chain.scale),
        *(*sigmas, " ".join(chain.merges), chain.state),
    ]


def _planar(event: Event) -> dict[str, float]:
    T = event.T_receiver_donor
    return {} if T is None else {"x_m": T.x_m, "y_m": T.y_m, "yaw_rad": T.yaw_rad, "scale": event.scale}
