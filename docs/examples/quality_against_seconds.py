"""Draw what each knob of accuracy costs in seconds, from the committed record of suite ``cost``.

The argument is the picture to write, such as docs/images/quality_against_seconds.png.
"""

import sys

import matplotlib.pyplot as plt

from radiogs_bench.results.records import RECORDS, read_record

KNOBS = {
    "steps of stage 1": ("stage1-half", "reference", "stage1-double"),
    "surfels": ("surfels-half", "reference", "surfels-double"),
    "steps of stage 2": ("iterations-quarter", "iterations-half", "reference", "iterations-double"),
    "rays a surfel, N_s": ("ns-half", "reference", "ns-double"),
    "surfels a step, N_g": ("ng-half", "reference", "ng-double"),
}
METRICS = {
    "nvs/psnr": "new views, PSNR (dB)", "relight/psnr": "relighting, PSNR (dB)", "normal/mae": "normals, error (deg)"
}  # fmt: skip


def main(path: str) -> None:
    """Draw a line for each knob through its rows, from the cheapest to the most expensive, in a panel a metric."""
    run = read_record(RECORDS / "cost.json")[0]
    seconds = {row["key"]: row["seconds"] for row in run["rows"]}
    figure, panels = plt.subplots(1, len(METRICS), figsize=(11, 3.4), layout="constrained")
    for panel, (metric, label) in zip(panels, METRICS.items(), strict=True):
        for (knob, rows), marker in zip(KNOBS.items(), "os^Dv", strict=True):
            means = [run["cells"][row][metric]["mean"] for row in rows]
            panel.plot([seconds[row] for row in rows], means, marker=marker, markersize=4, label=knob)
        panel.plot(seconds["reference"], run["cells"]["reference"][metric]["mean"], "ko", markersize=8, zorder=0)
        panel.set(xlabel="seconds of training, one core", title=label)
        panel.grid(alpha=0.3)
    panels[-1].invert_yaxis()  # better is up, as in the other panels
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(KNOBS), frameon=False)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main(sys.argv[1])
