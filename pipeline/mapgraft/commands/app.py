"""Every command with its arguments, as a person types it. What a command does is imported when it is asked for."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mapgraft import __version__

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    help="Graft the maps of several recorded robots into each other, verify, and take a wrong graft out again.",
)
plugins_app = typer.Typer(no_args_is_help=True, help="What is installed.")
app.add_typer(plugins_app, name="plugins")
experiment_app = typer.Typer(no_args_is_help=True, help="Published experiments, run again by one command.")
app.add_typer(experiment_app, name="experiment")
labels_app = typer.Typer(no_args_is_help=True, help="What people say of merges: out to a CSV file and in again.")
app.add_typer(labels_app, name="labels")

Files = Annotated[
    list[Path] | None, typer.Argument(help="Recordings: MCAP, ROS 1 bag, ROS 2 bag, CARMEN log, map.yaml.")
]
ConfigFile = Annotated[Path | None, typer.Option("--config", "-c", help="Configuration, YAML or TOML.")]
NoPlugin = Annotated[list[str] | None, typer.Option("--no-plugin", help="Leave a plugin out, by its entry point.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON for machines.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")]
Start = Annotated[float | None, typer.Option("--start", help="Seconds after the first stamp to begin at.")]
End = Annotated[float | None, typer.Option("--end", help="Seconds after the first stamp to end at.")]
EveryNth = Annotated[int | None, typer.Option("--every", help="Use every n-th scan only.")]


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"mapgraft {__version__}")
        raise typer.Exit


@app.callback()
def _top(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Say the version.")
    ] = False,
    debug: Debug = False,
) -> None:
    pass


@app.command()
def info(
    files: Files = None,
    config: ConfigFile = None,
    json: Json = False,
    no_plugin: NoPlugin = None,
    debug: Debug = False,
) -> None:
    """What is in a recording: robots, topics, poses that would be used, and what is wrong with it."""
    from mapgraft.commands.info import show_info

    show_info(files or [], config, as_json=json, without=no_plugin or [])


@app.command()
def run(
    files: Files = None,
    config: ConfigFile = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder to write to.")] = Path("mapgraft-out"),
    start: Start = None,
    end: End = None,
    every: EveryNth = None,
    reversal: Annotated[str | None, typer.Option(help="ledger, single_map or multi_map, for every robot.")] = None,
    prior: Annotated[list[str] | None, typer.Option(help="Known pose: RECEIVER,DONOR=X,Y,YAW (m, rad).")] = None,
    forbid: Annotated[list[str] | None, typer.Option(help="Never merge this pair: A,B.")] = None,
    demo: Annotated[str | None, typer.Option(help="Replay a demo: grids (else taken), heterogeneous.")] = None,
    verify_ledger: Annotated[
        bool, typer.Option("--verify-ledger", help="Recompute every layer and map at the end, and compare.")
    ] = False,
    report: Annotated[bool | None, typer.Option("--report/--no-report", help="Write report.html, too.")] = None,
    examples: Annotated[
        bool | None, typer.Option("--examples/--no-examples", help="Write every attempt with its pictures, too.")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress.")] = False,
    json: Json = False,
    no_plugin: NoPlugin = None,
    debug: Debug = False,
) -> None:
    """Replay recordings, merge the robots' maps, verify, revert; without a file the demo recording."""
    from mapgraft.commands.run import Overrides, run_and_show

    overrides = Overrides(start, end, every, reversal, tuple(prior or ()), tuple(forbid or ()), report, examples)
    run_and_show(
        files or [],
        config,
        out,
        overrides,
        demo_name=demo,
        quiet=quiet,
        as_json=json,
        without=no_plugin or [],
        verify_ledger=verify_ledger,
    )


@app.command()
def corpus(
    source: Annotated[str, typer.Argument(metavar="RUNS", help="A YAML file of missions, or a folder of recordings.")],
    dataset: Annotated[str, typer.Option("--out", "-o", help="Folder or URL (s3://…) of the data set to add to.")],
    config: Annotated[
        list[str] | None, typer.Option("--config", "-c", help="A configuration to run every mission with; repeatable.")
    ] = None,
    executor: Annotated[str, typer.Option(help="processes, threads or dask:ADDRESS.")] = "processes",
    workers: Annotated[int | None, typer.Option(min=1, help="How many on this machine; else one per CPU.")] = None,
    retries: Annotated[int, typer.Option(min=0, help="How often to try again what may pass.")] = 2,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="List the jobs, and which are done.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress.")] = False,
    json: Json = False,
    no_plugin: NoPlugin = None,
    debug: Debug = False,
) -> None:
    """Run many missions, each with every configuration, into one data set; what is there is not done again."""
    from mapgraft.commands.corpus import Asked, corpus_and_show

    asked = Asked(source, dataset, tuple(config or ()), executor, workers, retries, tuple(no_plugin or ()))
    corpus_and_show(asked, dry_run=dry_run, quiet=quiet, as_json=json)


Out = Annotated[Path, typer.Argument(help="The folder of an earlier run.")]
MergeId = Annotated[str, typer.Argument(help="A merge id, RECEIVER.DONOR.N, as the run's table shows it.")]
By = Annotated[str, typer.Option("--by", help="Who says so; kept in the event.")]
Reason = Annotated[str, typer.Option("--reason", help="Why; kept in the event.")]


@app.command()
def revert(
    out: Out, merge: MergeId, by: By = "", reason: Reason = "", json: Json = False, debug: Debug = False
) -> None:
    """Take one merge of an earlier run out, and compute everything that follows again."""
    from mapgraft.commands.hand import pass_verdict

    pass_verdict(out, merge, "revert", by, reason, as_json=json)


@app.command()
def confirm(
    out: Out, merge: MergeId, by: By = "", reason: Reason = "", json: Json = False, debug: Debug = False
) -> None:
    """Confirm one merge of an earlier run: no verifier takes it out any more."""
    from mapgraft.commands.hand import pass_verdict

    pass_verdict(out, merge, "confirm", by, reason, as_json=json)


@app.command()
def forbid(
    out: Out,
    merge: Annotated[str, typer.Argument(help="A merge id, or a pair A,B.")],
    json: Json = False,
    debug: Debug = False,
) -> None:
    """Never merge the two robots of a merge, and compute the run again without it."""
    from mapgraft.commands.hand import forbid_pair

    forbid_pair(out, merge, as_json=json)


@app.command()
def report(
    out: Annotated[Path, typer.Argument(help="The folder of a run, or of an experiment.")],
    to: Annotated[Path | None, typer.Option("--out", "-o", help="The file to write, if not report.html in it.")] = None,
    debug: Debug = False,
) -> None:
    """Write the page that shows a run (robots, timeline, every merge with pictures and reasons) or an experiment."""
    from mapgraft.commands.report import report_and_show

    report_and_show(out, to)


@app.command()
def annotate(
    folders: Annotated[list[Path], typer.Argument(metavar="OUT…", help="Folders of runs, evaluations, datasets.")],
    name: Annotated[str | None, typer.Option(help="Who annotates; else the page asks.")] = None,
    host: Annotated[
        str, typer.Option(help="The address to listen on; other machines reach all but this.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="The port to listen on; 0 takes a free one.")] = 0,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")] = True,
    debug: Debug = False,
) -> None:
    """Say in the browser which merges are right: a page of this machine, until Ctrl-C; answers are kept in OUT."""
    from mapgraft.commands.annotate import Asked, annotate_and_wait

    annotate_and_wait(folders, Asked(name, host, port, browser, tracebacks=debug))


@app.command()
def convert(
    source: Annotated[list[Path], typer.Argument(help="CARMEN logs, ROS 1 bags, ROS 2 bags.")],
    out: Annotated[Path, typer.Argument(help="The MCAP file to write.")],
    config: ConfigFile = None,
    debug: Debug = False,
) -> None:
    """Convert recordings to one ROS 2 MCAP."""
    from mapgraft.commands.convert import convert_and_show

    convert_and_show(source, out, config)


@app.command()
def decide(
    files: Files = None,
    config: ConfigFile = None,
    rules: Annotated[Path | None, typer.Option("--rules", help="A decision table to try instead.")] = None,
    own: Annotated[list[str] | None, typer.Option(help="A field of the receiver's metadata: NAME=VALUE.")] = None,
    other: Annotated[list[str] | None, typer.Option(help="A field of the donor's metadata: NAME=VALUE.")] = None,
    prior: Annotated[bool, typer.Option(help="A prior is known.")] = False,
    reversal: Annotated[str, typer.Option(help="How the receiver keeps merges.")] = "ledger",
    json: Json = False,
    no_plugin: NoPlugin = None,
    debug: Debug = False,
) -> None:
    """Say, rule by rule, what the decision table chooses for two maps, and why."""
    from mapgraft.commands.decide import Question, explain

    question = Question(tuple(own or ()), tuple(other or ()), prior, reversal)
    explain(files or [], config, rules, question, as_json=json, without=no_plugin or [])


@app.command()
def match(
    maps: Annotated[
        list[Path] | None,
        typer.Argument(metavar="A B", help="Two map files: A receives. map.yaml, PNG, PGM, or a type's own format."),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Folder for the picture and the merged map.")] = None,
    resolution: Annotated[float | None, typer.Option(help="Metres per pixel of maps that are bare images.")] = None,
    other_resolution: Annotated[float | None, typer.Option(help="The same of B, where it differs.")] = None,
    other_format: Annotated[str | None, typer.Option(help="The format of B, if its name tells another.")] = None,
    unknown_gray: Annotated[int | None, typer.Option(help="The gray, 0 to 255, that means unknown.")] = None,
    config: ConfigFile = None,
    rules: Annotated[Path | None, typer.Option("--rules", help="A decision table to use instead.")] = None,
    matcher: Annotated[str | None, typer.Option(help="This matcher instead of the rule's own.")] = None,
    hypotheses: Annotated[bool, typer.Option("--hypotheses", help="List all that the matcher found.")] = False,
    pairs: Annotated[list[Path] | None, typer.Option(help="A list of pairs with their truth; repeatable.")] = None,
    unrelated: Annotated[list[Path] | None, typer.Option(help="A list of pairs that must not merge.")] = None,
    across: Annotated[bool, typer.Option("--across", help="Nor any two listed maps of different places.")] = False,
    keypoint_px: Annotated[float, typer.Option(help="Keypoint error (RMS, pixels of A) up to which it is right.")] = 40,
    json: Json = False,
    no_plugin: NoPlugin = None,
    debug: Debug = False,
) -> None:
    """Match two ready maps: where B lies in A, what speaks for it, and the merged map if it was accepted.

    With --pairs, match a whole list and compare with its truth.
    """
    from mapgraft.commands.match import Asked, match_and_show

    without = tuple(no_plugin or ())
    asked = Asked(resolution, other_resolution, unknown_gray, config, rules, matcher, without, other_format)
    if not (pairs or unrelated):
        if across:
            raise typer.BadParameter("--across needs a list of pairs: name one with --pairs or --unrelated")
        match_and_show(maps or [], asked, out, as_json=json, all_hypotheses=hypotheses)
        return
    from mapgraft.commands.match_list import Lists, judge_and_show

    if maps or hypotheses:
        raise typer.BadParameter("--pairs and --unrelated go without A and B, and without --hypotheses (see --json)")
    lists = Lists(tuple(pairs or ()), tuple(unrelated or ()), across, keypoint_px)
    judge_and_show(lists, asked, out, as_json=json)


@app.command()
def evaluate(
    files: Annotated[list[Path], typer.Argument(help="Recordings whose poses can be trusted, each of another place.")],
    pairs: Annotated[int, typer.Option(help="How many pairs of windows to draw.")] = 200,
    scans: Annotated[int, typer.Option(help="Scans of a window.")] = 30,
    further: Annotated[int, typer.Option(help="Scans that the receiver maps on.")] = 10,
    across: Annotated[float, typer.Option(help="Share of pairs across recordings, where there are several.")] = 0.5,
    resolution: Annotated[float | None, typer.Option(help="The receiver's resolution (m).")] = None,
    other_resolution: Annotated[float | None, typer.Option(help="The donor's resolution (m).")] = None,
    seed: Annotated[int, typer.Option(help="Another seed draws other pairs.")] = 0,
    matcher: Annotated[str | None, typer.Option(help="A matcher in the place of the rules' own.")] = None,
    verifier: Annotated[str | None, typer.Option(help="A verifier in the place of the rules' own.")] = None,
    rules: Annotated[Path | None, typer.Option("--rules", help="A decision table to try instead.")] = None,
    map_type: Annotated[str | None, typer.Option("--type", help="Map type, if not the one a run would take.")] = None,
    other_type: Annotated[str | None, typer.Option(help="The donor's map type, if not the receiver's.")] = None,
    baseline: Annotated[bool, typer.Option(help="The paper's rules on the same pairs, too.")] = True,
    config: ConfigFile = None,
    jobs: Annotated[int, typer.Option(help="Processes to share the work.")] = 1,
    json: Annotated[str | None, typer.Option("--json", help="Write JSON to this file; - prints it instead.")] = None,
    truth: Annotated[Path | None, typer.Option(help="Labels (CSV): what they say goes before recorded poses.")] = None,
    examples: Annotated[Path | None, typer.Option(help="Folder to write every pair to, as an example.")] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress.")] = False,
    no_plugin: NoPlugin = None,
    debug: Debug = False,
) -> None:
    """Judge a matcher, its acceptance and its verification on pairs of maps from recordings with trusted poses."""
    from mapgraft.commands.evaluate import evaluate_and_show
    from mapgraft.evaluation.bench import Settings
    from mapgraft.evaluation.drawing import Drawing

    drawing = Drawing(pairs, scans, further, across, seed)
    settings = Settings(drawing, map_type, resolution, other_resolution, rules, matcher, verifier, baseline, other_type)
    evaluate_and_show(
        files,
        config,
        settings,
        jobs=jobs,
        quiet=quiet,
        json_out=json,
        without=no_plugin or [],
        truth=truth,
        examples=examples,
    )


@app.command()
def calibrate(
    datasets: Annotated[
        list[Path] | None,
        typer.Argument(help="Datasets, or folders of runs and evaluations with examples, labelled or with truth."),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Folder to write to.")] = None,
    false_accept: Annotated[
        float | None, typer.Option(help="Share of wrong hypotheses that may be merged; else 0.01.")
    ] = None,
    false_confirm: Annotated[
        float | None, typer.Option(help="Share of wrong hypotheses that may be confirmed; else 0.001.")
    ] = None,
    false_revert: Annotated[
        float | None, typer.Option(help="Share of right merges that may be reverted; else 0.01.")
    ] = None,
    score: Annotated[
        str | None, typer.Option(help="auto, fit, or the number that thresholds are set on, as posterior.log_odds.")
    ] = None,
    cost_false_accept: Annotated[
        float | None, typer.Option(help="What merging a wrong one costs; merge only what is worth it.")
    ] = None,
    cost_miss: Annotated[float | None, typer.Option(help="What not merging a right one costs; else 1.")] = None,
    used_on: Annotated[
        list[Path] | None,
        typer.Option("--for", help="Examples of the maps that it is meant for, without regard to labels; repeatable."),
    ] = None,
    without: Annotated[list[str] | None, typer.Option(help="Leave a building's labels out; repeatable.")] = None,
    held_back: Annotated[bool, typer.Option("--held-back", help="Read what datasets put aside for tests.")] = False,
    collecting: Annotated[
        Path | None, typer.Option(help="Write the rules by which to collect examples to this file, and nothing else.")
    ] = None,
    rules: Annotated[Path | None, typer.Option("--rules", help="The decision table to calibrate.")] = None,
    config: ConfigFile = None,
    json: Json = False,
    no_plugin: NoPlugin = None,
    debug: Debug = False,
) -> None:
    """Set thresholds from labelled examples to stated error rates, and say what they promise, and where nothing."""
    from mapgraft.commands.calibrate import Options, calibrate_and_show

    calibrate_and_show(
        datasets or [],
        out,
        Options(false_accept, false_confirm, false_revert, score, cost_false_accept, cost_miss),
        config=config,
        rules=rules,
        meant=used_on or [],
        without_building=without or [],
        held_back=held_back,
        collecting=collecting,
        as_json=json,
        without=no_plugin or [],
    )


@experiment_app.command("andersone2021")
def andersone2021(
    files: Annotated[
        list[Path] | None,
        typer.Argument(help="Recordings whose poses can be trusted; else the Intel log where it is, or the demo."),
    ] = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder to write to.")] = Path("andersone2021"),
    right: Annotated[int, typer.Option(help="Right merges per combination of resolutions.")] = 20,
    wrong: Annotated[int, typer.Option(help="Wrong merges per combination.")] = 20,
    seed: Annotated[int, typer.Option(help="Another seed draws other pairs.")] = 0,
    matcher: Annotated[str | None, typer.Option(help="A matcher in the place of Carpin's.")] = None,
    scans: Annotated[int, typer.Option(help="Scans of a partial map.")] = 30,
    further: Annotated[int, typer.Option(help="Scans that the receiver maps on.")] = 10,
    draws: Annotated[int | None, typer.Option(help="Pairs to try per combination, at most.")] = None,
    config: ConfigFile = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress.")] = False,
    json: Json = False,
    no_plugin: NoPlugin = None,
    debug: Debug = False,
) -> None:
    """Section 4 of the paper: right and wrong merges kept in one map, two maps and the ledger, measured, reverted."""
    from mapgraft.commands.experiment import conduct_and_show
    from mapgraft.experiments.andersone2021 import Settings

    settings = Settings(right, wrong, seed, matcher, scans, further, draws)
    conduct_and_show(files or [], config, out, settings, quiet=quiet, as_json=json, without=no_plugin or [])


@app.command()
def dataset(
    outs: Annotated[list[Path], typer.Argument(metavar="OUT…", help="Folders of runs or evaluations.")],
    to: Annotated[Path, typer.Option("--out", "-o", help="The dataset to write, or to add to.")],
    split: Annotated[
        list[str] | None, typer.Option(help="ENVIRONMENT=train, =validation or =test, if not as its name falls.")
    ] = None,
    licence: Annotated[str | None, typer.Option("--license", help="For the card, such as cc-by-4.0.")] = None,
    json: Json = False,
    debug: Debug = False,
) -> None:
    """Publish the examples of runs and evaluations with their labels as a dataset, split by building, with a card."""
    from mapgraft.commands.dataset import publish_and_show

    publish_and_show(outs, to, split or [], licence, as_json=json)


@labels_app.command("export")
def labels_export(
    outs: Annotated[list[Path], typer.Argument(metavar="OUT…", help="Folders of runs or evaluations, or datasets.")],
    to: Annotated[Path, typer.Option("--out", "-o", help="The CSV file to write.")] = Path("labels.csv"),
    everything: Annotated[bool, typer.Option("--all", help="Also what was said before, and withdrawn.")] = False,
    debug: Debug = False,
) -> None:
    """Write what people say of the examples in some folders to a CSV file."""
    from mapgraft.commands.labels import export_and_show

    export_and_show(outs, to, everything=everything)


@labels_app.command("import")
def labels_import(
    out: Annotated[Path, typer.Argument(help="The folder of a run or an evaluation, or a dataset.")],
    files: Annotated[list[Path], typer.Argument(metavar="CSV…", help="As labels export writes them.")],
    by: Annotated[str, typer.Option("--by", help="Who says so, where a line names nobody; else 'person'.")] = "",
    debug: Debug = False,
) -> None:
    """Add what CSV files say of examples to the labels of a folder; what is there already is not added again."""
    from mapgraft.commands.labels import import_and_show

    import_and_show(out, files, by)


@plugins_app.command("list")
def plugins_list(json: Json = False, no_plugin: NoPlugin = None, debug: Debug = False) -> None:
    """Every plugin with what it offers, and those that could not be loaded."""
    from mapgraft.commands.plugins import list_plugins

    list_plugins(as_json=json, without=no_plugin or [])


@plugins_app.command("show")
def plugins_show(
    name: Annotated[str, typer.Argument(help="A matcher, fuser, metric, …, by name.")],
    json: Json = False,
    debug: Debug = False,
) -> None:
    """One plugin's thing: what it is, where it comes from, its parameters."""
    from mapgraft.commands.plugins import show_plugin

    show_plugin(name, as_json=json)


@plugins_app.command("check")
def plugins_check(
    name: Annotated[str, typer.Argument(help="A plugin by its entry point, or a matcher, metric, … by name.")],
    examples: Annotated[int | None, typer.Option(min=1, help="Examples per law; more find more.")] = None,
    json: Json = False,
    debug: Debug = False,
) -> None:
    """Whether a plugin keeps the laws that make merges reversible, law by law; exit code 1 when it does not."""
    from mapgraft.commands.plugins_check import check_plugin

    check_plugin(name, as_json=json, examples=examples)


@plugins_app.command("new")
def plugins_new(
    name: Annotated[str, typer.Argument(help="The new plugin's name: lower-case letters, digits and '_'.")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Folder to write to; mapgraft-NAME here.")] = None,
    debug: Debug = False,
) -> None:
    """Write a package with a map type, a fuser, a metric, a rule and their tests, ready to be edited."""
    from mapgraft.commands.plugins_new import new_plugin

    new_plugin(name, out)
