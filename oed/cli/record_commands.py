"""Commands on saved records: `oed report`, `validate`, `export` and `animate`."""

from __future__ import annotations

import argparse
from pathlib import Path

from oed.cli.terminal.arguments import add_quiet, add_trust, add_workers, count, whole, workers_of
from oed.cli.terminal.command import DONE, FAILED, Command, CommandResult, answered, saved
from oed.cli.terminal.messages import tell


def _report_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "folders",
        metavar="DIR",
        nargs="+",
        help="a run; several are compared; a folder of runs gets an index",
    )
    parser.add_argument(
        "--out", metavar="DIR", help="where the page goes (default: DIR; a comparison: reports/comparison/)"
    )
    parser.add_argument(
        "--figures",
        metavar="FORMAT",
        action="append",
        choices=("pdf", "png"),
        default=[],
        help="figures also as pdf or png, beside the SVG of each; may be given again",
    )


def _report(options: argparse.Namespace) -> int:
    from oed.report import write_index

    folders = options.folders
    if len(folders) > 1:
        page = _compared(options)
    else:
        page = _page_of(options) or write_index(folders[0], options.out)
    return answered(options, {"report": str(page)}, lambda: tell(f"Page:  {page}"))


def _page_of(options: argparse.Namespace) -> Path | None:
    # The pages of all that is saved in a folder, or in the file that is named; None where it holds no run.
    from oed.foundation.work.folders import in_order
    from oed.records.record import ESTIMATE_FILE as ESTIMATE
    from oed.records.record import (
        FILE,
        LOOP_FILE,
        PLAN_FILE,
        SWEEP_FILE,
        load_estimate,
        load_loop,
        load_plan,
        load_record,
        load_sweep,
    )
    from oed.report import write_estimate, write_loop, write_plan, write_report, write_sweep

    folder, out, figures = options.folders[0], options.out, options.figures
    first, page = in_order(folder), None
    estimated, swept = (first / ESTIMATE).is_file(), (first / SWEEP_FILE).is_file()
    if estimated:
        page = write_estimate(load_estimate(first), out or first, figures)
    if (first / LOOP_FILE).is_file():
        return write_loop(load_loop(first), out or first, figures)
    if (first / PLAN_FILE).is_file():
        return write_plan(load_plan(first), out or first, figures)
    if swept:
        return write_sweep(load_sweep(first), first, out or first, figures)
    if (first / FILE).is_file() or not first.is_dir():
        return write_report(load_record(folder), out or first, figures)
    return page


def _compared(options: argparse.Namespace) -> Path:
    from oed.records.record import load_record
    from oed.report import write_comparison

    folders = options.folders
    _require_different(folders)
    records = [load_record(folder) for folder in folders]
    names = [Path(folder).resolve().name for folder in folders]
    labels = names if len(set(names)) == len(names) else folders
    return write_comparison(
        list(zip(labels, records, strict=True)),
        options.out or Path("reports") / "comparison",
        options.figures,
        dict(zip(labels, folders, strict=True)),
    )


def _require_different(folders: list[str]) -> None:
    from oed.foundation.errors import UserMistake
    from oed.records.record import FILE, saved_file

    known = dict[Path, str]()
    for folder in folders:
        path = saved_file(folder, FILE).resolve()
        if path in known:
            raise UserMistake(f"{known[path]} and {folder} are the same run: give each once")
        known[path] = folder


REPORT = Command(
    "report", "make the report again from a saved record; several are compared", _report, _report_arguments
)


def _validate_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", metavar="DIR")
    parser.add_argument("--replicates", type=count, help="simulated experiments (default: the study's)")
    parser.add_argument(
        "--heading",
        choices=("known", "predicted", "measured"),
        help="which headings the estimator uses (default: the study's)",
    )
    parser.add_argument(
        "--estimator",
        action="append",
        choices=("ols", "sandwich", "gls", "errors_in_variables", "nonlinear"),
        help="what estimates and predicts the covariance; may be given again (default: the study's)",
    )
    add_workers(parser)
    parser.add_argument("--seed", type=whole, help="seed of the noise (default: the record's)")
    add_trust(parser)
    add_quiet(parser)


def _validate(options: argparse.Namespace) -> int:
    from oed.cli.terminal.console import progress
    from oed.foundation.shown import shown
    from oed.foundation.work.folders import drafted
    from oed.records.record import load_record
    from oed.report import write_report
    from oed.report.film.animation import folder_of
    from oed.workflow.experiments import validated, validation_options
    from oed.workflow.saving import save_into

    workers = workers_of(options)
    with drafted(folder_of(options.folder)) as draft:
        before = load_record(options.folder)
        chosen = validation_options(
            before, replicates=options.replicates, estimators=options.estimator, heading=options.heading
        )
        with progress(options.quiet) as listener:
            record = validated(
                before, chosen, seed=options.seed, workers=workers, progress=listener, trust=options.trust
            )
        record, trouble = saved(lambda: save_into(draft, record))
    outcome = CommandResult(record.folder, draft.target, trouble)
    outcome.report(lambda: write_report(record, draft.target))
    found = record.validation
    assert found is not None
    verdicts = [shown(f"{one.name}, {one.estimator}: {one.verdict}") for one in found.results]
    outcome.show(options, found.plain(), lambda: tell(*verdicts))
    return FAILED if outcome.trouble else DONE


VALIDATE = Command(
    "validate", "simulate a saved record's designs; update record and report", _validate, _validate_arguments
)


def _export_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", metavar="DIR")
    parser.add_argument(
        "--to", required=True, metavar="FORMAT", help="csv, json, rosbag2, ros2_node or ros2_yaml"
    )
    parser.add_argument("--result", help="name of the result (default: the best)")
    parser.add_argument("--rate", type=float, help="of the commands [Hz] (default: the design's own)")
    parser.add_argument("--out", metavar="PATH", help="what to write (default: in DIR)")
    parser.add_argument("--storage", default="sqlite3", help="of a bag: sqlite3 (default) or mcap")
    parser.add_argument(
        "--message",
        metavar="TYPE",
        help="by which a node commands: twist_stamped, twist, ackermann, joint_state or float64_array",
    )
    parser.add_argument("--force", action="store_true", help="replace a bag that exists")
    add_trust(parser)


def _export(options: argparse.Namespace) -> int:
    from oed.exporters import export

    path = export(
        options.folder,
        options.to,
        result=options.result,
        rate=options.rate,
        out=options.out,
        storage=options.storage,
        message=options.message,
        force=options.force,
        trust=options.trust,
    )
    return answered(options, {"export": str(path)}, lambda: tell(str(path)))


EXPORT = Command(
    "export", "write a result's drive for a robot, or the robot's parameters", _export, _export_arguments
)


def _animate_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", metavar="DIR")
    parser.add_argument(
        "--result",
        metavar="NAME",
        nargs="+",
        action="extend",
        default=[],
        help="names of results, side by side, at most 4 (default: the best)",
    )
    parser.add_argument(
        "--to", choices=("gif", "mp4"), help="default: as --out ends, else gif; mp4 needs ffmpeg"
    )
    parser.add_argument("--speed", type=float, default=1.0, help="times as fast as the robot (default: 1)")
    parser.add_argument("--fps", type=float, help="frames a second (default: 20, of a long film fewer)")
    parser.add_argument(
        "--physics", action="store_true", help="drive it in simulated physics and film that (oed[physics])"
    )
    parser.add_argument(
        "--out", metavar="FILE", help="what to write (default: drive.gif in DIR, of physics physics.gif)"
    )
    add_trust(parser)
    add_quiet(parser)


def _animate(options: argparse.Namespace) -> int:
    from oed.cli.terminal.console import progress
    from oed.foundation.errors import UserMistake
    from oed.records.record import load_record
    from oed.report import animate, write_report
    from oed.report.film.animation import NAME, folder_of
    from oed.report.film.physics import film_physics

    folder = folder_of(options.folder)
    ending = "" if options.to is None else f".{options.to}"
    name = "physics.gif" if options.physics else NAME
    file = Path(options.out) if options.out else (folder / name).with_suffix(ending or ".gif")
    if file.suffix.lower() != (ending or file.suffix.lower()):
        raise UserMistake(f"{file}: expected a name that ends in {ending}, as --to says")
    with progress(options.quiet) as listener:
        more = {"speed": options.speed, "fps": options.fps, "progress": listener}
        if options.physics:
            film = film_physics(
                options.folder, file, result=_one(options.result), trust=options.trust, **more
            )
        else:
            film = animate(options.folder, file, results=options.result, **more)
    # A report that shows the film is made again with it.
    page = None
    if file.resolve() == (folder / NAME).resolve() and (folder / "report.html").is_file():
        page = write_report(load_record(folder), folder)
    size = film.file.stat().st_size
    data = {**vars(film), "file": str(film.file), "results": list(film.results), "bytes": size}
    data["report"] = None if page is None else str(page)
    lines = [f"film: {film.file} ({film.seconds:.3g} s, {size / 1e6:.2g} MB)"]
    lines += [] if page is None else [f"Page:  {page}"]
    return answered(options, data, lambda: tell(*lines))


def _one(names: list[str]) -> str | None:
    from oed.foundation.errors import UserMistake

    if len(names) > 1:
        raise UserMistake(f"--physics films one drive, got {', '.join(names)}")
    return names[0] if names else None


ANIMATE = Command(
    "animate", "make a film of a saved record's drives, for its report", _animate, _animate_arguments
)
