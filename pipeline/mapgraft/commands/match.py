"""``mapgraft match``: two ready maps from files, or a list of pairs whose truth is known."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from mapgraft.commands.match_text import print_pairing
from mapgraft.config import Config
from mapgraft.console import cell, print_json, remarks, results
from mapgraft.decision import build_table
from mapgraft.errors import ConfigError, UsageError
from mapgraft.evaluation.tables import wide
from mapgraft.guard import Guard
from mapgraft.job import as_config
from mapgraft.matching.document import document
from mapgraft.matching.folder import write_folder
from mapgraft.matching.pairing import Pairer
from mapgraft.matching.ready_map import FORMAT, RESOLUTION, ReadyMap, Shelf
from mapgraft.plugins import Plugins, load_plugins
from mapgraft.procedures import Workshop
from mapgraft.substitution import substituted

UNKNOWN_GRAY = "unknown_gray"


@dataclass(frozen=True, slots=True)
class Asked:
    """How the maps are to be read and matched."""

    resolution_m: float | None = None
    other_resolution_m: float | None = None
    unknown_gray: int | None = None
    config: Path | None = None
    rules: Path | None = None
    matcher: str | None = None
    without: Sequence[str] = ()
    other_format: str | None = None

    def __post_init__(self) -> None:
        if self.unknown_gray is not None and self.unknown_gray not in range(256):
            raise UsageError(f"--unknown-gray must lie in 0 … 255, found {self.unknown_gray}")


def match_and_show(
    maps: Sequence[Path], asked: Asked, out: Path | None, *, as_json: bool, all_hypotheses: bool
) -> None:
    """Match two map files, print what came of it, and write the folder if one is given."""
    if len(maps) != 2:
        raise UsageError(f"match takes two map files, A and B, found {len(maps)}; or a list of pairs with --pairs")
    plugins = load_plugins(asked.without)
    config = as_config(asked.config)
    pairer = pairer_of(plugins, config, asked)
    shelf = Shelf(plugins, config, pairer.workshop)
    with pairer.workshop.guard.armed():
        with naming_options():
            a, b = (shelf.read(path, given) for path, given in zip(maps, options_of(shelf, maps, asked), strict=True))
        for map_ in dict.fromkeys((a, b)):
            print_remarks(map_)
        pairing = pairer.pair(a, b)
        files = write_folder(out, pairing, pairer.workshop) if out is not None else []
    if as_json:
        times = {"match_s": pairing.match_s, "elapsed_s": pairing.elapsed_s}
        print_json({**document(pairing), **times, "files": files})
        return
    print_pairing(wide(results()), pairing, all_hypotheses=all_hypotheses)
    if files:
        results().print(cell(f"Written to {out}: {', '.join(files)}"), soft_wrap=True)


@contextmanager
def naming_options() -> Iterator[None]:
    """Faults of maps that were to be read name the option of this command, too."""
    try:
        yield
    except ConfigError as error:
        if RESOLUTION not in str(error):
            raise
        raise ConfigError(f"{error}; for this command --resolution METRES does, too") from None


def print_remarks(map_: ReadyMap) -> None:
    """What is probably not meant as a map file says, on stderr."""
    for remark in map_.remarks:
        remarks().print(cell(f"{remark} (--unknown-gray)" if UNKNOWN_GRAY in remark else remark), style="yellow")


def pairer_of(plugins: Plugins, config: Config, asked: Asked) -> Pairer:
    """What matches by the rules asked for; raises UsageError when they cannot be used."""
    table = substituted(build_table(plugins, asked.rules or config.rules), plugins, matcher=asked.matcher)
    workshop = Workshop(plugins, guard=Guard(config.limits))
    workshop.prepare(table)
    return Pairer(workshop, table)


def options_of(shelf: Shelf, maps: Sequence[Path], asked: Asked) -> list[dict[str, object]]:
    """The options of each of two files; raises UsageError when one was given that its file cannot use."""
    given = [options_for(shelf, path, side, asked) for side, path in enumerate(maps)]
    used = [options.get(RESOLUTION) for options in given]
    _require_used("--unknown-gray", asked.unknown_gray, maps, any(UNKNOWN_GRAY in options for options in given))
    _require_used("--resolution", asked.resolution_m, maps, asked.resolution_m in used)
    _require_used("--other-resolution", asked.other_resolution_m, maps[1:], asked.other_resolution_m == used[1])
    return given


def options_for(shelf: Shelf, path: Path, side: int, asked: Asked) -> dict[str, object]:
    """What was asked that the format of a file can use; ``side`` is 0 for A and 1 for B."""
    form = asked.other_format if side == 1 else None
    wanted: dict[str, object] = {UNKNOWN_GRAY: asked.unknown_gray, RESOLUTION: asked.resolution_m, FORMAT: form}
    if side == 1 and (asked.other_resolution_m is not None or form is not None):
        wanted[RESOLUTION] = asked.other_resolution_m  # what another format reads has pixels of another size
    return {name: value for name, value in wanted.items() if value is not None and shelf.takes(path, name, form)}


def _require_used(option: str, value: object, maps: Sequence[Path], used: bool) -> None:
    if value is not None and not used:
        names = " and ".join(path.name for path in maps)
        raise UsageError(
            f"{option} is of no use for {names}, whose format tells it by itself or has none: leave it out"
        )
