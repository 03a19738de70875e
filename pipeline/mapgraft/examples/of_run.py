"""The collector of a run: where its robots were recorded, and what is known of how their maps lie to each other."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import pyarrow as pa

from mapgraft.assembly import Assembly
from mapgraft.config import Config, ExamplesConfig
from mapgraft.contracts import Transform
from mapgraft.errors import ConfigError
from mapgraft.examples.collecting import Collector, Origin
from mapgraft.examples.pairs import contents_of, source_of
from mapgraft.examples.rows import examples_table
from mapgraft.examples.truths import GIVEN, RECORDED, Known, Truths, completed, inverted
from mapgraft.outputs.provenance import RunProvenance
from mapgraft.recording.naming import stem

if TYPE_CHECKING:
    from mapgraft.recording.mission import Mission


def collecting(
    paths: Sequence[Path],
    mission: Mission,
    assembly: Assembly,
    provenance: RunProvenance,
    config: Config,
    essence: str,
    write: Callable[[pa.Table], None],
) -> Collector:
    """A collector that looks on from now on; ``essence`` is the configuration as it goes into the run's id.

    Raises ConfigError when the truth is told of a robot that there is not, or cannot be read.
    """
    robots = {source.name: source.files for source in mission.robots}
    recordings = {name: stem(Path(files[0])) if files else stem(paths[0]) for name, files in robots.items()}
    named, whole = config.examples.environments, stem(paths[0])
    contents = contents_of(paths, config, provenance.inputs)
    origin = Origin(
        provenance.version,
        hashlib.sha256(essence.encode()).hexdigest(),
        hashlib.sha256(provenance.decision_table_text.encode()).hexdigest(),
        tuple(file.sha256 for file in provenance.inputs),
        recordings,
        {name: named.get(recording) or named.get(whole, whole) for name, recording in recordings.items()},
        {name: source_of(contents, files, name) for name, files in robots.items()},
    )
    buildings = {name: named[recording] for name, recording in recordings.items() if recording in named}
    truths = truths_of(config.examples, recordings, mission.T_world_map, buildings)
    workshop = next(iter(assembly.robots.values())).workshop
    collector = Collector(origin, workshop, lambda row: write(examples_table([row])), truths)
    assembly.history.onlookers.append(collector)
    return collector


def truths_of(
    config: ExamplesConfig,
    robots: Mapping[str, str],
    T_world_map: Mapping[str, Transform],
    buildings: Mapping[str, str],
) -> Truths:
    """What is known of every ordered pair of ``robots``, which tells the stem of each one's recording.

    ``buildings`` are those that persons have named.

    Where recorded poses are trusted, robots of two buildings that were named do not belong together. What is given goes
    before what was recorded, and what follows from several pairs is known, too.
    """
    truths: dict[tuple[str, str], Known] = {}
    pairs = [(receiver, donor) for receiver in robots for donor in robots if receiver != donor]
    for receiver, donor in pairs if config.trusted_poses else ():
        if receiver in T_world_map and donor in T_world_map:
            truths[receiver, donor] = Known(T_world_map[receiver].inverse() @ T_world_map[donor], RECORDED)
        elif receiver in buildings and donor in buildings and buildings[receiver] != buildings[donor]:
            truths[receiver, donor] = Known(None, RECORDED)
    given = dict(given_truths(config, robots))
    given = {**{pair[::-1]: inverted(known) for pair, known in given.items()}, **given}
    return {**completed(truths, robots), **completed(given, robots)}


def given_truths(config: ExamplesConfig, robots: Mapping[str, str]) -> Truths:
    """What the configuration tells itself of pairs of robots, one way round."""
    if isinstance(config.truth, Path):
        from mapgraft.examples.truths_csv import robots_truth

        told = robots_truth(config.truth, robots)
        return {pair: known for pair, known in told.items() if pair[0] in robots and pair[1] in robots}
    truths = {}
    for one in config.truth:
        if unknown := sorted({one.receiver, one.donor} - {*robots}):
            raise ConfigError(
                f"examples.truth: there is no robot {', '.join(unknown)}: the recording has {', '.join(sorted(robots))}"
            )
        T = None
        if one.x_m is not None and one.y_m is not None and one.yaw_rad is not None:
            T = Transform.planar(one.x_m, one.y_m, one.yaw_rad)
        truths[one.receiver, one.donor] = Known(T, GIVEN, one.scale)
    return truths
