"""Making the robots of a mission from its configuration and the installed plugins."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mapgraft.config import Config, ConsistencyConfig, MapConfig, RadioConfig
from mapgraft.contracts import ListeningPolicy, MapType
from mapgraft.correction import Recollection
from mapgraft.decision import DecisionTable
from mapgraft.errors import ConfigError, PluginError
from mapgraft.events import Sink
from mapgraft.graph.consistency import Settings
from mapgraft.graph.loops import Tolerance
from mapgraft.history import History, Journal
from mapgraft.lives import base_name
from mapgraft.network.radio import NS_PER_S, Conditions, Partition
from mapgraft.persons import Hand, given_priors, recorded_priors
from mapgraft.plugins import Plugins
from mapgraft.procedures import Workshop
from mapgraft.rendezvous import METRIC, Rendezvous
from mapgraft.replay import Exchange, Network
from mapgraft.reversal import new_reversal
from mapgraft.robot import Robot

if TYPE_CHECKING:
    from mapgraft.recording.mission import Mission


@dataclass(frozen=True, slots=True)
class Assembly:
    """Everything a replay needs, made from a mission, a configuration and the installed plugins."""

    robots: Mapping[str, Robot]
    exchange: Exchange
    history: History
    hand: Hand


def assemble(mission: Mission, config: Config, plugins: Plugins, table: DecisionTable, sink: Sink) -> Assembly:
    """Make the robots of a mission; raises ConfigError or PluginError when something does not fit."""
    guard = mission.guard  # one for all: only one can be armed at a time
    names = {base_name(source.name) for source in mission.robots}
    sees = sees_others(config, names)
    workshop, history = Workshop(plugins, guard=guard, further=(METRIC,) if sees else ()), History(sink)
    workshop.prepare(table)
    hand, consistency = hand_of(config, mission), settings_of(config.consistency)
    robots: dict[str, Robot] = {}
    for source in mission.robots:
        map_type = map_type_of(source.name, source.kinds, config, workshop)
        robot_config = config.robots.get(base_name(source.name))
        reversal_name = (robot_config.reversal if robot_config else None) or config.reversal
        reversal = new_reversal(reversal_name, map_type)
        journal = Journal(history, source.name, map_type, reversal, config.output.snapshots)
        made = (source.name, map_type, reversal, table, workshop, hand, journal)
        recollection = Recollection() if source.corrections else None
        robots[source.name] = Robot(
            *made,
            through=config.exchange.through,
            consistency=consistency,
            recollection=recollection,
            epoch=source.life,
            rendezvous=Rendezvous() if sees else None,
        )
    try:
        policy = workshop.policy(config.exchange.use, config.exchange.parameters)
        if isinstance(policy, ListeningPolicy):
            policy.hear(tuple(mission.signals(tuple(policy.topics))))
    except (ConfigError, PluginError) as error:
        raise ConfigError(f"exchange: {error}") from None
    network, name = network_of(config.radio, robots), config.exchange.use
    follows = {source.name: source.follows for source in mission.robots if source.follows}
    made_of = (policy, robots, mission.T_world_map, network)
    exchange = Exchange(*made_of, guard=guard, history=history, policy_name=name, follows=follows)
    return Assembly(robots, exchange, history, hand)


def sees_others(config: Config, names: Collection[str]) -> bool:
    """Whether it is told of robots that saw each other; raises ConfigError where one of them is none."""
    told = [(f"robots.{robot}.sightings", one.robot) for robot, r in config.robots.items() for one in r.sightings]
    told += [("meetings", name) for one in config.meetings for name in (one.a, one.b)]
    for where, name in told:
        if name not in names:
            raise ConfigError(f"{where}: there is no robot {name!r}: the recording has {', '.join(sorted(names))}")
    return bool(told)


def network_of(config: RadioConfig, robots: Iterable[str]) -> Network:
    """How the robots reach each other; raises ConfigError where a partition speaks of a robot that there is not."""
    names = set(robots)
    partitions = []
    for cut in config.partitions:
        if unknown := sorted({name for group in cut.groups for name in group} - names):
            raise ConfigError(f"radio.partitions: there is no robot {', '.join(unknown)}: {', '.join(sorted(names))}")
        end_ns = None if cut.end_s is None else round(cut.end_s * NS_PER_S)
        groups = tuple(frozenset(n for n in names if n in group or base_name(n) in group) for group in cut.groups)
        partitions.append(Partition(round(cut.start_s * NS_PER_S), end_ns, groups))
    times_ns = [round(s * NS_PER_S) for s in (config.latency_s, config.jitter_s, config.held_up_s)]
    conditions = Conditions(
        latency_ns=times_ns[0],
        jitter_ns=times_ns[1],
        bandwidth_bytes_s=config.bandwidth_bytes_s,
        loss=config.loss,
        duplication=config.duplication,
        reordering=config.reordering,
        held_up_ns=times_ns[2],
        partitions=tuple(partitions),
        seed=config.seed,
    )
    return Network(conditions, round(config.window_s * NS_PER_S), round(config.patience_s * NS_PER_S), config.previews)


def settings_of(config: ConsistencyConfig) -> Settings:
    """How merges in loops are judged."""
    from scipy.special import chdtri  # the limit of chi-square that so much of it lies below

    limits = tuple((freedom, float(chdtri(freedom, 1.0 - config.quantile))) for freedom in (3, 6))
    told = (config.sigmas, config.floor_m, config.floor_rad)
    tolerance = Tolerance(*told, chi2=limits, cap_m=config.cap_m, cap_rad=config.cap_rad)
    return Settings(config.margin, tolerance=tolerance, trials=config.trials)


def map_type_of(name: str, kinds: Iterable[str], config: Config, workshop: Workshop) -> MapType:
    """The map type of one robot: as configured, else the installed one that prefers what the robot observes."""
    name = base_name(name)
    robot = config.robots.get(name)
    own, default = robot.map if robot else MapConfig(), config.map
    chosen = own.type or default.type or preferred_type(kinds, workshop.plugins)
    where = f"robots.{name}.map" if robot else "map"
    inherited = default.parameters if default.type in (None, chosen) else {}
    parameters = {**inherited, **(own.parameters if own.type in (None, chosen) else {})}
    try:
        return workshop.new_map_type(chosen, parameters)
    except (ConfigError, PluginError) as error:
        raise ConfigError(f"{where}: {error}") from None


def preferred_type(kinds: Iterable[str], plugins: Plugins) -> str:
    """The map type that prefers these payload kinds most; raises ConfigError when none takes any of them."""
    wanted = sorted(set(kinds))
    ranked = sorted(
        (-offered.descriptor.observes[kind], offered.descriptor.name)
        for offered in plugins.of_kind("map type")
        for kind in wanted
        if kind in offered.descriptor.observes
    )
    if not ranked:
        raise ConfigError(
            f"no installed map type observes {', '.join(wanted) or 'nothing'}: see 'mapgraft plugins list'"
        )
    return ranked[0][1]


def hand_of(config: Config, mission: Mission) -> Hand:
    """What persons said, checked against the robots there are; raises ConfigError for a name that is none."""
    names = sorted(source.name for source in mission.robots)
    said = {name for prior in config.priors for name in (prior.receiver, prior.donor)}
    said |= {name for pair in config.forbid for name in pair}
    if unknown := sorted(said - set(names)):
        raise ConfigError(f"there is no robot {', '.join(unknown)}: the recording has {', '.join(names)}")
    told = recorded_priors(mission.T_world_map) if config.mission.known_poses else {}
    return Hand(
        priors={**told, **given_priors(config.priors)},
        forbidden=frozenset(frozenset(pair) for pair in config.forbid),
        verdicts=tuple(config.verdicts),
    )
