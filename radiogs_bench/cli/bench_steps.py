"""``radiogs-bench bench steps|growth``: seconds of single steps at named sizes, and how they grow with size."""

import argparse
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from radiogs_core.errors import UsageError

from .device import chosen_device
from .options import add_verbose, names, positive

if TYPE_CHECKING:
    from ..lab.steps.sizes import Size
    from .options import Commands

SIZES = ("tiny", "20k")
"""Those that take a minute or two."""


def add_to(subjects: "Commands") -> None:
    """Declare the two subjects of ``bench``."""
    steps = subjects.add_parser("steps", help="steps, starting points and relit frames of a method", allow_abbrev=False)
    steps.set_defaults(command=bench_steps, threads=1)
    steps.add_argument(
        "--sizes", type=names, default=SIZES, metavar="A,B", help="of tiny,20k,small,paper (default: tiny,20k)"
    )
    steps.add_argument("--passes", type=positive, metavar="N", help="how often all is done (default: by size, 1 to 4)")
    steps.add_argument("--stages", type=positive, metavar="N", help="only the first N stages, without relighting")
    other = steps.add_mutually_exclusive_group()
    other.add_argument("--compare", type=Path, metavar="FILE", help="ratios to an earlier record of this machine")
    other.add_argument("--against", type=Path, metavar="CHECKOUT", help="ratios to another checkout, pass by pass")
    steps.add_argument("--history", type=Path, metavar="FILE", help="add a line: this commit, relative to yardsticks")
    growth = subjects.add_parser("growth", help="how seconds and bytes grow with size", allow_abbrev=False)
    growth.set_defaults(command=bench_growth, threads=1)
    for each in (steps, growth):
        each.add_argument("--method", default="radiogs", metavar="NAME", help="(default: radiogs)")
        each.add_argument("--scene", default="corner", help="enlarged to each size (default: corner)")
        each.add_argument("--device", choices=["cpu", "cuda"], default="cpu", help="(default: cpu)")
        each.add_argument("--json", type=Path, metavar="FILE", help="write everything that was measured")
        add_verbose(each)


def bench_steps(options: argparse.Namespace) -> int:
    """Measure, print, and write the record."""
    from ..lab.steps.sizes import size_of
    from ..methods import method

    method(options.method)  # an unknown name is told before anything is measured
    sizes = [size_of(name) for name in options.sizes]
    return _alone(options, sizes) if options.against is None else _in_turn(options, sizes)


def bench_growth(options: argparse.Namespace) -> int:
    """Measure along every axis, print the exponents, and write the record."""
    from radiogs_datasets import load_scene

    from ..lab.steps.growth import SCHEMA, bench_growth
    from ..lab.steps.growth_table import growth_table
    from ..methods import method
    from ..store.provenance import session
    from .reporter import complain, show

    device = chosen_device(options)
    began = session(device)
    rows = list(bench_growth(method(options.method), load_scene(options.scene), device, complain))
    show(growth_table(rows))
    _write(options.json, {"schema": SCHEMA, **began, **_place(options), "rows": rows})
    return 0


def _alone(options: argparse.Namespace, sizes: Sequence["Size"]) -> int:
    """This checkout, in this process, beside yardsticks; ratios to an earlier record where one was named."""
    from ..lab.steps.history import append, line_of
    from ..lab.steps.measure import Here, measured
    from ..lab.steps.ratios import read_record, require_comparable
    from ..lab.steps.record import as_table, record_of, yardstick_said
    from ..lab.steps.worker import named_subject
    from ..lab.steps.yardsticks import Yardsticks
    from ..store.provenance import session
    from .reporter import complain, say, show

    device, found = chosen_device(options), {}
    began = session(device)
    earlier = None if options.compare is None else read_record(options.compare)
    if earlier is not None:
        require_comparable({**began, **_place(options)}, earlier)
    yardsticks = Yardsticks()
    here = Here(partial(named_subject, options.method, options.scene, options.device), options.stages)
    for size in sizes:
        yardsticks.measure()
        (found[size.name],) = measured([here], size, options.passes or size.passes, complain)
        show(as_table(size.name, found[size.name]))
    yardsticks.measure()
    record = record_of(began, _place(options), yardsticks, found)
    say(yardstick_said(record))
    if earlier is not None:
        _ratios(found, earlier["sizes"], paired=False)
    _write(options.json, record)
    if options.history is not None:
        append(options.history, line_of(record))
    return 0


def _in_turn(options: argparse.Namespace, sizes: Sequence["Size"]) -> int:
    """This checkout and another one, each in a process of its own, pass by pass in turn."""
    from ..lab.steps.against import worker
    from ..lab.steps.measure import measured
    from ..lab.steps.ratios import AGAINST
    from ..store.provenance import session
    from .reporter import complain

    if options.history is not None:
        raise UsageError("--history is of this checkout alone", "", "Leave out --against.")
    device, ours, theirs = chosen_device(options), {}, {}
    given = (options.method, options.scene, options.device, str(options.stages or 0))
    with worker(options.against, given) as other, worker(None, given) as this:
        for size in sizes:
            passes = options.passes or size.passes
            theirs[size.name], ours[size.name] = measured([other, this], size, passes, complain)
        commits = {"this": this.origin["git"], "other": other.origin["git"]}
    ratios = _ratios(ours, theirs, paired=True)
    record = {"this": ours, "other": theirs, "commits": commits, "ratios": ratios}
    _write(options.json, {"schema": AGAINST, **session(device), **_place(options), **record})
    return 0


def _ratios(ours: Mapping[str, Any], theirs: Mapping[str, Any], paired: bool) -> dict[str, list[dict[str, Any]]]:
    """Print the ratios of the sizes that both have, and return them."""
    from ..lab.steps.ratios import as_table, compared
    from .reporter import show

    found = {name: list(compared(each, theirs[name], paired)) for name, each in ours.items() if name in theirs}
    if not found:
        raise UsageError("the record has none of these sizes", f"It has: {', '.join(theirs)}.", "Choose them: --sizes")
    for name, ratios in found.items():
        show(as_table(name, ratios))
    return found


def _place(options: argparse.Namespace) -> dict[str, str]:
    return {"method": options.method, "scene": options.scene}


def _write(path: Path | None, record: Mapping[str, Any]) -> None:
    from ..store.atomic import write_atomically
    from ..store.seal import sealed, strict_json

    if path is not None:
        write_atomically(path, strict_json(sealed(record)))
