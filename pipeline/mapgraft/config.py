"""The configuration: one YAML (or TOML) file, checked as a whole, every fault reported at once with its path."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from mapgraft.documents import parse_toml, parse_yaml, read_text
from mapgraft.errors import ConfigError

ClockName = Literal["auto", "header", "log"]
ReversalName = Literal["ledger", "single_map", "multi_map"]
TURN_RAD = 2.0 * math.pi
Seconds = Annotated[float, Field(allow_inf_nan=False)]
_MOST_KEYS = 6  # of those beside one that is missing


class Section(BaseModel):
    """A part of the configuration in which an unknown key is a fault."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Choice(BaseModel):
    """A plugin by name with its parameters beside it: ``{use: every, seconds: 30}``."""

    model_config = ConfigDict(extra="allow", frozen=True)
    use: str

    @property
    def parameters(self) -> dict[str, Any]:
        return dict(self.model_extra or {})


class ExchangeConfig(Choice):
    """When robots meet: a policy by name with its parameters beside it, ``{use: every, seconds: 30}``.

    ``through`` says by which merges of other robots a third one's layer is attached: those that are confirmed, also
    provisional ones, or none.
    """

    through: Literal["confirmed", "provisional", "none"] = "confirmed"


class ConsistencyConfig(Section):
    """How merges that lead around in a loop are judged.

    A loop closes when the squared Mahalanobis distance of its residual is below the ``quantile`` of chi-square, with
    the standard deviations that the merges state times ``sigmas``, and ``floor_m`` and ``floor_rad`` per merge for what
    cells and bent maps hide. A residual of more than ``cap_m`` or ``cap_rad`` is never taken for closed. A merge is
    called wrong when every explanation in which it is right is worse by ``margin`` nats; otherwise it is in dispute.
    With ``trials`` a robot measures its own merges that lie in such loops on the maps themselves.
    """

    quantile: Annotated[float, Field(gt=0.5, lt=1.0)] = 0.999
    sigmas: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 3.0
    floor_m: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 0.1
    floor_rad: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 0.01
    cap_m: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 2.0
    cap_rad: Annotated[float, Field(gt=0, le=TURN_RAD)] = 0.26
    margin: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 3.0
    trials: bool = True


class PartitionConfig(Section):
    """A cut of the radio, in seconds from the mission's start: meanwhile only robots of one group hear each other.

    Without ``end_s`` it lasts to the end.
    """

    start_s: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    end_s: Seconds | None = None
    groups: list[list[str]]

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.end_s is not None and self.end_s <= self.start_s:
            raise ValueError(f"end_s must lie after start_s, found {self.start_s} to {self.end_s}")
        return self


class RadioConfig(Section):
    """What happens to messages between robots; by default they arrive at once, and all of them.

    They arrive ``latency_s`` after they left, and up to ``jitter_s`` later; a robot sends ``bandwidth_bytes_s``.
    ``loss``, ``duplication`` and ``reordering`` are probabilities per message: never to arrive, to arrive twice, to be
    held up for ``held_up_s``. A contact that the exchange policy begins lasts ``window_s``; a robot asks again after
    ``patience_s``. With ``previews`` a robot first asks for what a map looks like, and for the map itself only when
    that is worth a closer look.
    """

    latency_s: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    jitter_s: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    bandwidth_bytes_s: Annotated[float, Field(ge=1, allow_inf_nan=False)] | None = None
    loss: Annotated[float, Field(ge=0, lt=1)] = 0.0
    duplication: Annotated[float, Field(ge=0, lt=1)] = 0.0
    reordering: Annotated[float, Field(ge=0, lt=1)] = 0.0
    held_up_s: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 1.0
    partitions: list[PartitionConfig] = Field(default_factory=list)
    window_s: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 10.0
    patience_s: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 1.0
    previews: bool = False
    seed: int = 0


class MapConfig(BaseModel):
    """A map type by name with its parameters beside it: ``{type: occupancy_grid, resolution_m: 0.05}``.

    Without a type the robot gets the type that prefers what the robot observes.
    """

    model_config = ConfigDict(extra="allow", frozen=True)
    type: str | None = None

    @property
    def parameters(self) -> dict[str, Any]:
        return dict(self.model_extra or {})


class PosesConfig(Section):
    """Where a robot's poses come from. What is left out is discovered.

    ``file``: another recording or a TUM trajectory that holds the poses of these scans. ``topic``: an odometry or pose
    topic instead of the tf tree. ``max_gap_s``: how far the nearest poses on both sides of a scan may lie apart in
    time; a scan without a pose is counted and left out. ``max_speed_m_s``: a scan whose pose has jumped farther than a
    robot of this speed moves is counted and left out, until the poses stay where they jumped to. ``prefix``: put before
    bare frames of ``/<robot>/tf``. ``corrections``: a topic of ``nav_msgs/Path`` on which the robot tells anew where it
    was, as after closing a loop; whenever one comes the robot maps anew what it has observed. ``parents`` says on which
    frame one hangs that the recording hangs on several.
    """

    file: Path | None = None
    topic: str | None = None
    map_frame: str | None = None
    base_frame: str | None = None
    prefix: str | None = None
    corrections: str | None = None
    parents: dict[str, str] = Field(default_factory=dict)
    max_gap_s: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 0.5
    max_speed_m_s: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 50.0


class WindowConfig(Section):
    """A cut of a recording in seconds since its first stamp: from ``start_s`` (included) to ``end_s`` (excluded)."""

    start_s: Seconds = 0.0
    end_s: Seconds | None = None

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.end_s is not None and self.end_s <= self.start_s:
            raise ValueError(f"end_s must lie after start_s, found {self.start_s} to {self.end_s}")
        return self


class SightingsConfig(Section):
    """A topic on which a robot tells where another one's base lies, by poses in a frame that is fixed to itself.

    ``sigma_m`` and ``sigma_yaw_rad`` are standard deviations where the messages tell none; without the latter only
    the place counts.
    """

    robot: str
    topic: str
    sigma_m: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 0.2
    sigma_yaw_rad: Annotated[float, Field(gt=0, le=TURN_RAD)] | None = None


class RobotConfig(Section):
    """One robot. Everything has a default from discovery; ``mapgraft info`` shows what would be used.

    ``source`` names the discovered robot this one is taken from (default: the one of the same name); with ``window``
    several robots can be cut from one recording, each with a map frame of its own that starts at its first pose.
    ``files`` are paths, names or patterns of the files that hold it. ``options`` are for the format that reads a
    ready-made map file: ``{unknown_gray: 205}``. ``clock`` is as in the mission. ``clock_offset_s`` is added to its
    stamps; where it is left out, robots that one recorder heard, or that share ``mission.common_event``, are brought
    together by it. ``restarts`` says when its map frame began anew: seconds since the recording's first stamp, a topic
    each of whose messages says so, or ``files``: with every one of them. It is another robot then, ``<name>~2``.
    """

    source: str | None = None
    files: list[str] = Field(default_factory=list)
    options: dict[str, Any] = Field(default_factory=dict)
    scans: list[str] | None = None
    maps: list[str] | None = None
    poses: PosesConfig = PosesConfig()
    window: WindowConfig | None = None
    restarts: list[Seconds] | str | None = None
    clock: ClockName | None = None
    clock_offset_s: Seconds | None = None
    sightings: list[SightingsConfig] = Field(default_factory=list)
    map: MapConfig = MapConfig()
    reversal: ReversalName | None = None


class PriorConfig(Section):
    """What is known beforehand about where the donor's map frame lies in the receiver's."""

    receiver: str
    donor: str
    x_m: Seconds
    y_m: Seconds
    yaw_rad: Annotated[float, Field(ge=-TURN_RAD, le=TURN_RAD)]  # more is surely meant in degrees
    sigma_m: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 0.5
    sigma_yaw_rad: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 0.1


class MeetingConfig(Section):
    """What is known of where two robots lay to each other: the base of ``b`` in that of ``a``, ``at_s`` of the mission.

    Without ``yaw_rad`` only the place is known.
    """

    a: str
    b: str
    at_s: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    x_m: Seconds
    y_m: Seconds
    yaw_rad: Annotated[float, Field(ge=-TURN_RAD, le=TURN_RAD)] | None = None
    sigma_m: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 0.2
    sigma_yaw_rad: Annotated[float, Field(gt=0, le=TURN_RAD)] = 0.1


class VerdictConfig(Section):
    """A person's word on a merge, replayed whenever that merge comes up again.

    ``T_receiver_donor`` (16 numbers, row-major) is the transform that the person judged; ``mapgraft revert`` and
    ``confirm`` fill it in. With it the verdict holds for any merge of these two robots at that place.
    """

    merge: str
    action: Literal["revert", "confirm"]
    T_receiver_donor: Annotated[list[float], Field(min_length=16, max_length=16)] | None = None
    by: str = ""
    reason: str = ""


class MissionConfig(Section):
    """The timeline: ``aligned`` shifts robots that recorded one after another to a common start.

    With ``known_poses`` the relative poses that the recording itself tells are priors for every pair of robots.
    ``clock`` says what the time of a message is: the stamp in its ``header``, also where it cannot be true, or the time
    of recording (``log``). ``auto`` takes the stamps where they are of use, and the time of recording for those that
    cannot be true. ``common_event`` is a topic whose messages the recorders of several files have heard alike: their
    clocks are brought together by it.
    """

    start: Literal["aligned", "recorded"] = "aligned"
    start_s: Annotated[float, Field(ge=0, allow_inf_nan=False)] | None = None
    end_s: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    every: Annotated[int, Field(ge=1)] = 1
    typestore: str = "ros2_humble"
    known_poses: bool = False
    clock: ClockName = "auto"
    common_event: str | None = None

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.start_s is not None and self.end_s is not None and self.end_s <= self.start_s:
            raise ValueError(f"end_s must lie after start_s, found {self.start_s:g} to {self.end_s:g}")
        return self


class LimitsConfig(Section):
    """How much is taken from a recording and from plugins that may be broken or hostile; all else goes on.

    ``chunk_bytes`` is what one chunk or compressed message may unpack to, ``expansion`` how many times its own size a
    file may; ``beams`` of one scan and ``grid_cells`` of one ready-made map; ``robots`` of one mission; ``extent_m`` is
    how far from a robot's first observation its others may lie. ``plugin_s`` is how long one call of a plugin may take
    by the clock, and after ``failures`` failures, or one that took too long, it is not asked again.
    """

    chunk_bytes: Annotated[int, Field(ge=1)] = 128 << 20
    expansion: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 1000.0
    beams: Annotated[int, Field(ge=1)] = 100_000
    grid_cells: Annotated[int, Field(ge=1)] = 40_000_000
    robots: Annotated[int, Field(ge=1)] = 100
    extent_m: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 50_000.0
    plugin_s: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 300.0
    failures: Annotated[int, Field(ge=1)] = 3


class OutputConfig(Section):
    """What is written beside the events.

    ``snapshots`` writes maps to the MCAP before and after merges and reverts, ``examples`` the table of all attempts
    with pictures, ``report`` the page ``report.html``.
    """

    snapshots: bool = True
    scans: bool = False
    examples: bool = True
    report: bool = True


class TruthConfig(Section):
    """Where a donor's map really lies in a receiver's; without a pose the two do not belong together."""

    receiver: str
    donor: str
    x_m: Seconds | None = None
    y_m: Seconds | None = None
    yaw_rad: Annotated[float, Field(ge=-TURN_RAD, le=TURN_RAD)] | None = None
    scale: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 1.0

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if len({self.x_m is None, self.y_m is None, self.yaw_rad is None}) > 1:
            raise ValueError("a true pose is x_m, y_m and yaw_rad, or none of them")
        return self


class ExamplesConfig(Section):
    """What is known of the examples of a run, beside what the run finds out; it makes no other run.

    ``environments`` tells of recordings, by their stems, in which building they were made, where it is called
    otherwise. With ``trusted_poses`` the recorded poses are the truth: robots whose map frames the recording places in
    one world lie as it says. ``truth`` tells of pairs of robots, in place or as a CSV file that ``mapgraft labels
    export`` has written; it goes before recorded poses.
    """

    environments: dict[str, str] = Field(default_factory=dict)
    trusted_poses: bool = False
    truth: list[TruthConfig] | Path = Field(default_factory=list)


Rate = Annotated[float, Field(gt=0, lt=1)]
Cost = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class CalibrateConfig(Section):
    """What ``mapgraft calibrate`` is to promise; its options go before. A run does not look at it.

    At most these shares of wrong hypotheses are merged (``false_accept``) and confirmed, and of right merges reverted.
    ``score`` is ``auto``, ``fit``, or the number to go by. With ``cost_false_accept`` nothing is merged that costs more
    than it saves, where not to merge what is right costs ``cost_miss``.
    """

    false_accept: Rate = 0.01
    false_confirm: Rate = 0.001
    false_revert: Rate = 0.01
    score: str = "auto"
    cost_false_accept: Cost | None = None
    cost_miss: Cost = 1.0


class Config(Section):
    mission: MissionConfig = MissionConfig()
    robots: dict[str, RobotConfig] = Field(default_factory=dict)
    map: MapConfig = MapConfig()
    reversal: ReversalName = "ledger"
    exchange: ExchangeConfig = ExchangeConfig.model_validate({"use": "every", "seconds": 30.0})
    radio: RadioConfig = RadioConfig()
    consistency: ConsistencyConfig = ConsistencyConfig()
    rules: list[dict[str, Any]] | Path | None = None
    priors: list[PriorConfig] = Field(default_factory=list)
    meetings: list[MeetingConfig] = Field(default_factory=list)
    forbid: list[tuple[str, str]] = Field(default_factory=list)
    verdicts: list[VerdictConfig] = Field(default_factory=list)
    output: OutputConfig = OutputConfig()
    examples: ExamplesConfig = ExamplesConfig()
    limits: LimitsConfig = LimitsConfig()
    calibrate: CalibrateConfig = Field(default=CalibrateConfig(), exclude=True)  # so that no run depends on it

    @field_validator("robots")
    @classmethod
    def _names(cls, robots: dict[str, RobotConfig]) -> dict[str, RobotConfig]:
        for name in robots:
            check_robot_name(name)
        return robots


def check_robot_name(name: str) -> str:
    """A robot's name becomes a topic, a frame and a file name; raises ValueError when it cannot."""
    if not name or len(name) > 100 or name in (".", "..") or not all(c.isalnum() or c in "_-@." for c in name):
        raise ValueError(f"a robot's name is letters, digits, '_', '-', '@' and '.', found {name!r}")
    return name


def load_config(path: Path) -> Config:
    """Read a YAML or TOML file; relative paths inside are taken from the file's own folder.

    Raises ConfigError when it cannot be read or does not fit.
    """
    return parse_config(read_mapping(path), origin=str(path), folder=path.parent)


def parse_config(given: Mapping[str, Any], origin: str = "the configuration", folder: Path | None = None) -> Config:
    """Check a mapping; raises ConfigError with all faults at once, each with its path."""
    try:
        config = Config.model_validate(given)
    except ValidationError as error:
        faults = [f"  {path_of(fault['loc'])}: {text_of(fault)}" for fault in error.errors()]
        raise ConfigError(f"{origin} has {len(faults)} fault{'s' * (len(faults) > 1)}:\n" + "\n".join(faults)) from None
    return config if folder is None else _anchored(config, folder)


def read_mapping(path: Path) -> dict[str, Any]:
    """The mapping in a YAML 1.2 or TOML file; raises ConfigError with one sentence."""
    text = read_text(path, str(path), ConfigError)
    parse = parse_toml if path.suffix == ".toml" else parse_yaml
    given = parse(text, str(path), ConfigError)
    if given is None:
        return {}
    if not isinstance(given, dict):
        raise ConfigError(f"{path} must hold a mapping (key: value), found a {type(given).__name__}")
    return given


def _anchored(config: Config, folder: Path) -> Config:
    robots = {name: _anchored_robot(robot, folder) for name, robot in config.robots.items()}
    rules = folder / config.rules if isinstance(config.rules, Path) else config.rules
    examples = config.examples
    if isinstance(examples.truth, Path):
        examples = examples.model_copy(update={"truth": folder / examples.truth})
    return config.model_copy(update={"robots": robots, "rules": rules, "examples": examples})


def _anchored_robot(robot: RobotConfig, folder: Path) -> RobotConfig:
    files = [str(folder / name) if _is_there(folder / name) else name for name in robot.files]
    poses = robot.poses
    if poses.file is not None:
        poses = poses.model_copy(update={"file": folder / poses.file})
    return robot.model_copy(update={"files": files, "poses": poses})


def _is_there(path: Path) -> bool:
    """Whether there is such a file; behind doors that are closed to this user it may be: who opens it will say so."""
    try:
        return path.exists()
    except PermissionError:
        return True


def path_of(location: tuple[int | str, ...]) -> str:
    """Where in the document a fault lies, as ``robots.alice.map``."""
    return ".".join(str(part) for part in location) or "(top)"


def text_of(fault: Mapping[str, Any]) -> str:
    """What a fault of pydantic's is, in a sentence for a person."""
    if fault["type"] == "extra_forbidden":
        return "there is no such key; check the spelling"
    if fault["type"] == "missing" and isinstance(fault["input"], Mapping):
        return _missing(str(fault["loc"][-1]), [str(key) for key in fault["input"]])
    text = str(fault["msg"]).removeprefix("Value error, ")
    return f"{text}, found {_shown(fault['input'])}" if not isinstance(fault["input"], dict | list) else text


def _missing(key: str, beside: list[str]) -> str:
    """A key that must be there, and what is there: beside it any other may be a plugin's parameter, or be misspelt."""
    meant = get_close_matches(key, beside, 1)
    found = ", ".join(map(_shown, meant or beside[:_MOST_KEYS]))
    return "Field required" + (f", found {found}" if found else "") + (": check the spelling" if meant else "")


def _shown(value: object) -> str:
    """A value as Python writes it, shortened: it may be as long as the file."""
    try:
        return reprlib.repr(value)
    except ValueError:  # a number of more digits than Python writes
        return "a number of thousands of digits"
