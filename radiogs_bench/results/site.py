"""Publishes finished runs and records as a static site that names no folder of this machine."""

import hashlib
import json
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from statistics import fmean
from typing import NamedTuple

from radiogs_baselines.published import values_beside
from radiogs_core.errors import UsageError, unknown
from radiogs_core.own_files import fresh
from radiogs_datasets.data_root import scene_folders
from radiogs_datasets.generate.surfaces import metadata_of
from radiogs_datasets.registry import load_scene
from radiogs_reports.page.site import DATA, FILTERS, PROVENANCE, SITE_SCHEMA, Line, site_files
from radiogs_reports.summary import LIMIT, RecordedRun, RunTable, Summary, counted_scenes, protocol_title
from radiogs_reports.tables.caption import division, origin
from radiogs_reports.wording import marked

from ..runs.rows_from_files import measured
from ..runs.sweep import CellRef, Sweep, label, read_sweep
from ..store.atomic import explained, write_atomically
from ..store.folder import Store, product_name
from ..store.keys import content_key
from ..store.opening import opened
from ..store.schema import Result
from .doubts import labels
from .records import read_record, without_out
from .reports import damage_explained
from .stored_cells import as_stored
from .summary import summarise, why_absent

CHECKSUMS = "checksums.txt"

OWN = re.compile(rf"index\.html|{re.escape(DATA)}|(pages|pictures)/(?!\.)[\w.-]+")
"""Names of the files of a site."""

FREE = re.compile(r"CC0( 1\.0)?|CC BY( \d\.\d)?|public domain|Apache-2\.0|MIT")
"""Licences that allow anybody to show pictures of a scene."""

FOLDERS = re.compile(r"(?<![\w.:/<])/(?:[^\s/'\"\\,;:()=]+/)*(?=[^\s/'\"\\,;:()=])")
"""Pattern of the folders of an absolute path in a text."""


class _Run(NamedTuple):
    """A run's folder, with cells as they were stored; ``results`` has None for an unfinished cell."""

    store: Store
    sweep: Sweep
    results: Mapping[str, Result | None]
    made: Summary


def publish(sources: Sequence[Path], to: Path, with_pictures_of: Collection[str] = ()) -> list[Line]:
    """Write the site of runs (folders) and records (files) into ``to``; returns the lines of its table.

    ``with_pictures_of``: scenes whose pictures are shown whatever their licence. Raises DataError for a source that is
    not as it was stored, UsageError for an unknown scene and for a folder ``to`` that holds other files, StoreError.
    """
    earlier, arrays = _earlier(to), dict[str, Path]()
    runs, lines = list[RunTable](), list[Line]()
    for source in dict.fromkeys(sources):
        if source.is_file():
            runs += (records := read_record(source))
            lines += [line for record in records for line in _lines_of_record(record)]
            continue
        run = _read_run(source)
        runs.append(run.made)
        for group in _by_row_and_scene(run.sweep["cells"]):
            lines.append(line := _line(run, group, with_pictures_of))
            if line["page"] and not line["without"]:
                arrays[line["page"]] = run.store.arrays_path(_finished(run, group)[0]["key"])
    known = {scene for each in runs for scene in each["scenes"]}
    for name in with_pictures_of:
        if name not in known:
            raise unknown("scene", name, sorted(known))
    columns = {column["key"]: column for each in reversed(runs) for column in each["columns"]}
    lines = json.loads(FOLDERS.sub("", json.dumps(lines, ensure_ascii=False)))
    with explained(to), damage_explained():
        _write(to, earlier, site_files([*columns.values()], lines, arrays))
    return lines


def _earlier(to: Path) -> dict[str, str]:
    """Digests of an earlier site's files by name; empty for a new folder. Raises UsageError if it holds other files."""
    if not to.exists() or (to.is_dir() and not any(to.iterdir())):
        return {}
    try:
        with opened(to / DATA) as file:
            schema = json.loads(file.read())["schema"]
    except (OSError, ValueError, LookupError, TypeError):
        schema = None
    if schema != SITE_SCHEMA:
        raise UsageError(
            f"{to} holds other files than a site of this version ({SITE_SCHEMA})",
            "They could be replaced.",
            "Name a new folder, an empty one, or that of an earlier `publish`.",
        )
    path, listed = to / CHECKSUMS, dict[str, str]()
    if path.is_file():
        with opened(path) as file:
            listed = {name: digest for digest, name in re.findall(r"^(\w{64})  (.+)$", file.read().decode(), re.M)}
    return {name: digest for name, digest in listed.items() if OWN.fullmatch(name)}


def _write(to: Path, earlier: Mapping[str, str], files: Iterator[tuple[str, bytes]]) -> None:
    """Write the files and their checksums; remove unchanged files of the earlier site that the new one lacks."""
    made: dict[str, str] = {}
    for name, content in files:
        if name not in made:
            write_atomically(fresh(to / name, to), content)
            made[name] = hashlib.sha256(content).hexdigest()
    for name in earlier.keys() - made.keys():
        path = fresh(to / name, to)
        if path.is_file() and _digest(path) == earlier[name]:
            path.unlink()
    text = "".join(f"{digest}  {name}\n" for name, digest in sorted(made.items()))
    write_atomically(fresh(to / CHECKSUMS, to), text.encode())


def _digest(path: Path) -> str:
    with opened(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _by_row_and_scene(cells: Sequence[CellRef]) -> list[list[CellRef]]:
    groups: dict[tuple[str, str], list[CellRef]] = {}
    for ref in cells:
        groups.setdefault((ref["row"], ref["scene"]), []).append(ref)
    return [*groups.values()]


def _facts(run: RunTable, told: Mapping[str, str], recipe: str, **further: str) -> dict[str, str]:
    """The facts of a line of the site's table. ``told``: the origin of its values."""
    known = {
        "suite": run["suite"], "preset": run["preset"], "machine": run["machine"], "recipe": recipe,
        "division": division(recipe), "seeds": ", ".join(map(str, run["seeds"])),
        "commit": told.get("Commit", told.get("Version", "")),
    } | {name.lower(): text for name, text in told.items() if name in ("Date", "Command")}  # fmt: skip
    return {name: (known | further).get(name, "") for name in (*FILTERS, *PROVENANCE)}


def _lines_of_record(run: RecordedRun) -> Iterator[Line]:
    for row in run["rows"]:
        cells, scene = run["cells"].get(row["key"], {}), f"mean of {', '.join(counted_scenes(run))}"
        yield Line(
            row=row["text"],
            page="",
            facts=_facts(run, run["origin"], run["recipe"], scene=scene, protocol=run["protocol"]),
            values={"mean": {column: cell["mean"] for column, cell in cells.items()}},
            reasons={column: cell["reason"] or "" for column, cell in cells.items()},
            missing=[],
            card={},
            without="",
        )


def _read_run(folder: Path) -> _Run:
    """A run without rows scored from files. Raises DataError for a changed or damaged cell."""
    store, sweep = Store(folder), measured(read_sweep(folder))
    why = "A site shows only what the program has written."
    results = {ref["key"]: as_stored(store, ref["key"], sweep, why) for ref in sweep["cells"]}
    made = summarise(store, sweep, *values_beside(sweep["published"], sweep["columns"]))
    settings = labels([(ref, results[ref["key"]]) for ref in sweep["cells"]], sweep)  # a card has its own
    made["doubts"] = [each for each in made.get("doubts", []) if each not in settings]
    words = without_out(made.get("command", []))  # in a word, names of folders may have blanks
    made["command"] = [re.sub(r"(^|[=,])/[^,]*/(?=[^,])", r"\1", word) for word in words]
    return _Run(store, sweep, results, made)


def _finished(run: _Run, group: Sequence[CellRef]) -> list[Result]:
    return [result for ref in group if (result := run.results[ref["key"]]) is not None]


def _line(run: _Run, group: Sequence[CellRef], allowed: Collection[str]) -> Line:
    """A row on a scene: means over its seeds and, where one has finished, the card of its models."""
    made, scene, results = run.made, group[0]["scene"], _finished(run, group)
    row = next(each for each in run.sweep["rows"] if each["key"] == group[0]["row"])
    cells = {each["key"]: each for each in made["runs"]}
    done = [cells[result["key"]] for result in results]
    missing = [f"{label(ref)}: {cells[ref['key']]['state'].partition(':')[0]}"
               for ref in group if run.results[ref["key"]] is None]  # fmt: skip
    facts = _facts(made, origin({**made, "runs": done}), row.get("recipe", ""), scene=marked(made, scene))
    facts |= {"protocol": protocol_title(made), "seeds": ", ".join(str(each["seed"]) for each in done)}
    values: dict[str, dict[str, float | None]] = {
        "mean": {},
        **{f"seed {each['seed']}": each["metrics"] for each in done},
    }
    line = Line(row=row["text"], page="", facts=facts, values=values, reasons={}, missing=missing, card={}, without="")
    for column in (each["key"] for each in made["columns"]):
        known = [value for each in done if (value := each["metrics"].get(column)) is not None]
        values["mean"][column] = fmean(known) if known else None
        stored = results[0]["metrics"].get(column) if results else None
        absent = why_absent(scene, results[0], column) if results else "not finished"
        line["reasons"][column] = (stored and stored["reason"]) or absent
    if results:
        cell, stated = results[0]["cell"], made.get("stated", {}).get(scene, {})
        facts["method"] = cell["method"]
        licence, credits, free = licence_of(scene, cell["checksum"], stated)
        if not free and scene not in allowed:
            line["without"] = f"Pictures are left out: the licence of {scene} is {licence}."
        line["page"] = f"pages/{content_key({'cells': group, 'run': run.sweep['seal']})}.html"
        line["card"] = _card(run, group, line, [f"licence: {licence}", *credits])
    return line


def _card(run: _Run, group: Sequence[CellRef], line: Line, terms: Sequence[str]) -> dict[str, list[str]]:
    """The model's card: sentences by heading."""
    first, facts, scene = _finished(run, group)[0], line["facts"], group[0]["scene"]
    cell, told = first["cell"], first["facts"].get("labels")
    size = [f"{name.replace('_', ' ')}: {value}" for name, value in first.get("data", {}).items()]
    source = "recovered from the images" if "environment" in first["maps"] else "not recovered as a map"
    settings = [f"{name}: {text}" for name, text in told.items()] if isinstance(told, Mapping) else []
    limit = run.made.get("stated", {}).get(scene, {}).get(LIMIT)
    limits = [f"the BRDF cannot represent {limit}, which the scene has"] if limit else []
    limits += [each["text"] for each in run.made["doubts"] if group[0]["row"] in each["rows"]]
    seconds = [f"{name}: {value:.1f} s" for name, value in first["seconds"].items()]
    return {
        "Model": [f"{line['row']}, of suite {facts['suite']}: {run.made['title']}", f"method: {facts['method']}",
                  f"recipe: {facts['recipe'] or 'none'}; division: {facts['division']}; preset: {facts['preset']}"],
        "Data": [f"scene {facts['scene']}: {run.made.get('kinds', {}).get(scene) or 'kind not stated'}", *size,
                 f"digest of its files: {cell['checksum']}", *terms],
        "Light": [f"training light: {'given' if 'light' in cell['variant'].get('given', ()) else source}",
                  f"relit under: {first['shown_light'] or 'no other light'}"],
        "Settings": settings or ["none stored"],
        "Limits": limits or ["none stored"],
        "How it was made": [facts["command"], f"commit {facts['commit'] or 'unknown'}, {facts['date']}",
                            facts["machine"], *seconds],
        "Checksums (SHA-256)": [*_checksums(run, group)],
    }  # fmt: skip


def _checksums(run: _Run, group: Sequence[CellRef]) -> Iterator[str]:
    """Digests of the stored files of each seed: its result, its arrays, and the products of its training stages."""
    for ref in (each for each in group if run.results[each["key"]] is not None):
        products = [f"{product_name(key)}.pt" for key in ref["stages"]]
        for name in (f"cells/{ref['key']}.json", f"cells/{ref['key']}.npz", *products):
            path = run.store.folder / name
            yield f"seed {ref['seed']}: {_digest(path) if path.is_file() else 'not there'}  {name}"


def licence_of(scene: str, checksum: str, stated: Mapping[str, str]) -> tuple[str, list[str], bool]:
    """The licence of a scene in words, its credits, and whether anybody may show pictures by it.

    A scene of the package is known by its files' ``checksum``; others state a licence in their metadata, or none.
    """
    folder = scene_folders().get(scene)
    if folder is None or checksum.partition("/")[0] != _checksum(scene):
        licence = stated.get("licence", "not known")
        return licence, [], all(FREE.fullmatch(each) for each in licence.split(", "))
    about = metadata_of(folder)
    credits = [", ".join(each.values()) for each in about.get("credits", ())]
    return about.get("licence", "Apache-2.0, of this project"), credits, True


@cache
def _checksum(scene: str) -> str:
    return load_scene(scene).checksum
