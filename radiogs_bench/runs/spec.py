"""A run as a value: everything that a user asks for, the same from the shell, Python, JSON and for a worker."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from radiogs_core.errors import UsageError, unknown
from radiogs_core.plain_values import PlainReader, to_plain
from radiogs_core.transport.plan import Effects, checked_effects
from radiogs_datasets.options import AS_STORED, SceneOptions

MOST_SEEDS = 10_000
"""Seeds of one run: all cells of all seeds are listed before anything is run."""

OTHER_NAMES = {"method": "methods", "set": "settings"}
"""Fields that Python also takes by the names of the shell's options."""

REMEDY = "What can be asked of a run:  radiogs-bench run --help"


@dataclass(frozen=True)
class RunSpec:
    """The request for a run. Raises UsageError for values that no run can have.

    The folder of results and trusted method files are not part of it: both belong to the call that runs it.
    """

    suite: str
    """Name of a suite, or path of a suite's TOML file."""
    methods: tuple[str, ...] = ()
    """Methods that run in the suite's table, by name or file; empty: the methods of the rows."""
    rows: tuple[str, ...] = ()
    """Keys of the rows that run; empty: all."""
    scenes: tuple[str, ...] = ()
    """Scenes by name or folder; empty: the suite's own."""
    scene_options: SceneOptions = AS_STORED
    """How the scenes are opened."""
    seeds: int = 1
    """Number of seeds: 0 to ``seeds`` - 1 are run."""
    preset: str = ""
    """Preset of every method's budget; empty: ``paper`` as published, else ``tiny``."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Plain values for fields of variants and budgets, by dotted names (``methods.settings_of``)."""
    recipe: str = ""
    """Recipe of the rows that name none; empty: the suite's."""
    effects: Effects = "all"
    """Effects that rows simulate; ``all`` leaves the rows as they are."""
    protocol: str = ""
    """Metric protocol; empty: the suite's."""
    as_published: bool = False
    """Whether the published table that the suite reproduces is run (``suites.data_sets.as_published``)."""
    device: str = "cpu"
    """``cpu`` or ``cuda``."""
    threads: int | None = None
    """CPU threads; None: one for each core."""
    shard: tuple[int, int] = (0, 1)
    """Part i of n of the cells, counted from 0."""
    keep_views: int | None = None
    """Test views whose pictures are kept with a result; None: as many as fit (``scoring.kept_views``)."""

    def __post_init__(self) -> None:
        if not 1 <= self.seeds <= MOST_SEEDS:
            raise UsageError(f"{self.seeds} seeds: one run takes 1 to {MOST_SEEDS}")
        if not 0 <= self.shard[0] < self.shard[1]:
            raise UsageError(f"there is no part {self.shard[0]} of {self.shard[1]}", "Parts are counted from 0.")
        for name, number in (("threads", self.threads), ("keep_views", self.keep_views)):
            if number is not None and number < (name == "threads"):
                raise UsageError(f"{name}: {number} is too small")
        object.__setattr__(self, "effects", checked_effects(self.effects))
        if self.effects != "all" and {"effects", "variant.effects"} & self.settings.keys():
            raise UsageError(
                "'effects' is set twice", "", "Give every field once (--effects sets the field 'effects')."
            )

    @classmethod
    def of(cls, suite: str, **options: Any) -> "RunSpec":
        """A spec from keywords: its fields, the fields of ``SceneOptions``, and the names of the shell's options.

        Lists are taken for tuples, and None for the default. Raises UsageError for an unknown name or a wrong value.
        """
        own = {each.name for each in fields(cls)} - {"suite", "scene_options"}
        opening = {each.name for each in fields(SceneOptions)}
        given = {OTHER_NAMES.get(name, name): value for name, value in options.items() if value is not None}
        for name in given:
            if name not in own | opening:
                raise unknown("option", name, sorted(own | opening | OTHER_NAMES.keys()), of="run()")
        scenes = {name: str(value) if name == "mask_folder" else value for name, value in given.items()}
        plain = {name: value for name, value in given.items() if name in own}
        plain["scene_options"] = {name: value for name, value in scenes.items() if name in opening}
        return cls.from_plain({"suite": suite, **plain}, "run()")

    @classmethod
    def from_plain(cls, values: Mapping[str, Any], source: str = "a run") -> "RunSpec":
        """A spec from plain values, as ``plain`` gives them. Raises UsageError that names ``source`` and the field."""
        made: RunSpec = PlainReader(source, REMEDY).build(cls, values, "")
        return made

    @classmethod
    def from_json(cls, text: str) -> "RunSpec":
        """A spec from JSON. Raises UsageError for what ``to_json`` could not have written."""
        try:
            values = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise UsageError(f"the run is no JSON: {error}", "", REMEDY) from error
        return cls.from_plain(values)

    def plain(self) -> dict[str, Any]:
        """The fields as plain values."""
        return to_plain(self)

    def to_json(self) -> str:
        """The spec as JSON, from which ``from_json`` makes an equal one."""
        return json.dumps(self.plain())
