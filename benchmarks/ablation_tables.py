# SPDX-License-Identifier: Apache-2.0
"""Writes the results of an ablation (ablation.py): TABLE.md for people, TABLE.csv and TABLE_curve.csv for programs,
and TABLE.svg if matplotlib is installed (plots.py)."""

import csv
import io
import math
import os
from typing import NamedTuple

import plots

# Key: column in CSV and JSON. Value: title, factor to its unit, and decimals in Markdown.
FIGURES = {
    "psnr": ("PSNR", 1, 2),
    "psnr_unexposed": ("PSNR unexposed", 1, 2),
    "ssim": ("SSIM", 1, 4),
    "lpips": ("LPIPS", 1, 4),
    "psnr_critical": ("PSNR-C", 1, 2),
    "psnr_noncritical": ("PSNR-NC", 1, 2),
    "psnr_moving": ("PSNR moving", 1, 2),
    "psnr_pedestrians": ("PSNR people", 1, 2),
    "depth": ("depth error m", 1, 2),
    "gaussians": ("Gaussians", 1, 0),
    "bytes": ("MB", 1e-6, 1),
    "training_seconds": ("training s", 1, 1),
    "training_cpu_seconds": ("CPU s", 1, 1),
    "beside": ("s / s beside", 1, 3),
    "peak_rss_bytes": ("peak MB", 1e-6, 0),
    "render_ms": ("render ms", 1, 2),
    "fps": ("frames / s", 1, 1),
    "pairs": ("M pairs", 1e-6, 2),
}
QUALITIES = list(FIGURES)[:8]  # compared as a difference
RATIOS = ["gaussians", "training_seconds", "training_cpu_seconds", "render_ms", "pairs", "fps"]
OF_MOMENT = ["psnr", "psnr_critical", "psnr_noncritical"]


def write(path, text):
    """Writes a file by replacing it atomically; follows links, and writes directly to a device, FIFO or socket."""
    path = os.path.realpath(path)
    part = path if os.path.exists(path) and not os.path.isfile(path) else f"{path}.part"
    with open(part, "w", encoding="utf-8") as file:
        file.write(text)
    if part != path:
        os.replace(part, path)


# ---- Tables ----


def mean_and_range(results, figure):
    """Mean and range (largest less smallest) of a figure over the results that have it. The range of fewer than two
    values is NaN, and so is the mean of none."""
    values = [result[figure] for result in results if result[figure] is not None]
    mean = math.fsum(values) / len(values) if values else math.nan
    return mean, max(values) - min(values) if len(values) > 1 else math.nan


def cell(value, decimals, sign=""):
    return f"{round(value, decimals) + 0.0:{sign}.{decimals}f}" if math.isfinite(value) else "-"  # no -0.00


def markdown_table(heads, rows):
    lines = [heads, ["---", *["---:"] * (len(heads) - 1)], *rows]
    return "".join(f"|{'|'.join(line)}|\n" if line[0] == "---" else f"| {' | '.join(line)} |\n" for line in lines)


class Tables:
    """Writes TABLE.md, TABLE.csv (one line per row and seed) and TABLE_curve.csv (one line per moment)."""

    def __init__(self, ablation):
        self.ablation, self.own, self.equal = ablation, ablation.results["own"], ablation.results["equal"]

    def write(self):
        a = self.ablation
        write(f"{a.output}.md", self.markdown())
        write(f"{a.output}.csv", self.csv(list(FIGURES), lambda result: [result]))
        moment = ["step", "gaussians", "seconds", "cpu_seconds", *OF_MOMENT]
        text = self.csv(moment, lambda result: result["moments"])
        write(
            f"{a.output}_curve.csv", text.replace(",seconds,cpu_seconds,", ",training_seconds,training_cpu_seconds,", 1)
        )

    def csv(self, columns, lines):
        text = io.StringIO()
        table = csv.writer(text, lineterminator="\n")
        table.writerow(["row", "seed", "count", *columns])
        for kind, results in self.ablation.results.items():
            for result in [result for results_of_row in results.values() for result in results_of_row]:
                for line in lines(result):
                    values = ["" if line[c] is None else f"{line[c]:.10g}" for c in columns]
                    table.writerow([result["row"], result["seed"], kind, *values])
        return text.getvalue()

    def spread(self, figure):
        """The largest range over seeds of all rows, as an estimate of differences due to chance; NaN if no row has
        several seeds."""
        ranges = [mean_and_range(results, figure)[1] for results in self.own.values()]
        return max([r for r in ranges if math.isfinite(r)], default=math.nan)

    def title(self, name):
        return self.ablation.layout.names.get(name, f"`{name}`")

    def markdown(self):
        a = self.ablation
        page = f"# {a.layout.title} on {os.path.basename(a.dataset)}, {a.iterations} steps\n\n"
        page += (
            "Held-out views. PSNR in dB; C: critical, NC: not critical pixels; means of the seeds (largest less smallest in brackets). MB: the "
            "scene's files. Training: wall clock and processor time. Render: mean over the held-out views of the shortest of three drawings. Pairs: mean of a frame.\n\n"
        )
        networks = sorted({r["lpips_network"] for results in self.own.values() for r in results if r["lpips_network"]})
        if networks:
            page += f"LPIPS is over {' and '.join(networks)}{', which can not be compared' if len(networks) > 1 else ''}.\n\n"
        if a.beside:
            page += f"s / s beside: wall clock of the training by that of `{a.beside.name}`, which was trained just before each row for it.\n\n"
        spreads = [
            (FIGURES[q][0], cell(self.spread(q), FIGURES[q][2])) for q in QUALITIES if math.isfinite(self.spread(q))
        ]
        if spreads:
            page += "Spread over seeds (largest less smallest, the largest of all rows that were repeated): "
            page += ", ".join(" ".join(s) for s in spreads) + ". A difference within it is called none.\n\n"
        else:
            page += "Each row was trained once: how much of a difference is chance is not known.\n\n"
        page += self.figures(self.own)
        if a.equal_count:
            page += (
                f"\n## At equal count\n\nEach row that prunes by a score was pruned by it to {a.equal_count} Gaussians, the smallest of their "
                "counts, at the last prune, and trained on.\n\n"
            ) + self.figures(self.equal)
        return page + self.equal_time() + self.options()

    def figures(self, sets):
        """Tables of the means of each finished row and of their differences from the row `plain`, or from the
        first row if there is no such row."""
        done = {name: results for name, results in sets.items() if results}
        shown = [f for f in self.ablation.layout.figures if any(r[f] is not None for of in done.values() for r in of)]
        rows = []
        for name, results in done.items():
            rows.append([self.title(name)])
            for figure in shown:
                (mean, spread), (_, unit, decimals) = mean_and_range(results, figure), FIGURES[figure]
                brackets = f" ({spread * unit:.{decimals}f})" if math.isfinite(spread) else ""
                rows[-1].append(cell(mean * unit, decimals) + brackets)
        page = markdown_table(["row", *(FIGURES[f][0] for f in shown)], rows)
        if len(done) < 2:
            return page
        reference = "plain" if "plain" in done else next(iter(done))
        qualities, ratios, rows = [q for q in QUALITIES if q in shown], [r for r in RATIOS if r in shown], []
        for name, results in done.items():
            if name == reference:
                continue
            rows.append([self.title(name)])
            for figure in qualities:
                difference = mean_and_range(results, figure)[0] - mean_and_range(done[reference], figure)[0]
                none = abs(difference) <= self.spread(figure)
                rows[-1].append("none" if none else cell(difference, FIGURES[figure][2], "+"))
            for figure in ratios:
                mean, of = mean_and_range(results, figure)[0], mean_and_range(done[reference], figure)[0]
                rows[-1].append(f"{mean / of:.2f}x" if of else "-")
        return f"{page}\nAgainst {self.title(reference)}:\n\n" + markdown_table(
            ["row", *(FIGURES[f][0] for f in [*qualities, *ratios])], rows
        )

    def equal_time(self):
        """Table of the quality that each row had reached when the fastest row finished, and at half of that time."""
        firsts = {name: self.own[name][0] for name in trainings(self.ablation)}
        if len(firsts) < 2:
            return ""
        end = min(result["training_seconds"] for result in firsts.values())
        heads = ["row", "PSNR, half", "PSNR", "PSNR-C, half", "PSNR-C", "PSNR-NC, half", "PSNR-NC"]
        rows = []
        for name, result in firsts.items():
            values = [quality_at(result["moments"], when, key) for key in OF_MOMENT for when in (end / 2, end)]
            rows.append([self.title(name), *(cell(value, 2) for value in values)])
        return (
            f"\nAt equal time: what each row had reached after {end / 2:.0f} s and after {end:.0f} s of training, when the quickest was done (first "
            f"seed, at most {self.ablation.moment_views} held-out views, between moments interpolated):\n\n"
        ) + markdown_table(heads, rows)

    def options(self):
        common = f", each behind `{' '.join(self.ablation.train)}`" if self.ablation.train else ""
        page = f"\nRows, as options of `pags train`{common}:\n\n"
        for row in self.ablation.rows:
            train = f"`{' '.join(row.train.words())}`" if row.train.given else "no other"
            evaluated = f"; evaluated with `{' '.join(row.eval.words())}`" if row.eval.given else ""
            page += f"- {self.title(row.name)}: {train}{evaluated}{'' if self.own[row.name] else '; not finished'}\n"
        return page


def quality_at(moments, seconds, key):
    """Quality after `seconds` of training, interpolated linearly between moments; NaN before the first moment."""
    number = [(m["seconds"], math.nan if m[key] is None else m[key]) for m in moments]
    for (t0, q0), (t1, q1) in zip([(math.nan, math.nan), *number], number):
        if t1 > seconds:
            return q0 + (q1 - q0) * (seconds - t0) / (t1 - t0)
    return number[-1][1]


# ---- Plots ----


class Layout(NamedTuple):
    """The content of TABLE.md and TABLE.svg: `names` are titles of rows, `panels` functions from an ablation to a list
    of plots.Panel."""

    title: str = "Ablation"
    names: dict = {}
    figures: list = [f for f in FIGURES if f != "fps"]
    panels: list = []


def trainings(ablation):
    """Names of the finished rows; of rows that only render another's training, of the first one alone."""
    names = {
        " ".join(row.train.words()): row.name for row in reversed(ablation.rows) if ablation.results["own"][row.name]
    }
    return [row.name for row in ablation.rows if row.name in names.values()]


def qualities_of(ablation):
    """Titles and keys of PSNR; those of regions only if a result has them."""
    critical = any(math.isfinite(mean_and_range(r, "psnr_critical")[0]) for r in ablation.results["own"].values())
    qualities = {"PSNR": "psnr", "PSNR, critical pixels": "psnr_critical", "PSNR, other pixels": "psnr_noncritical"}
    return dict(list(qualities.items())[: 3 if critical else 1])


def panels_of(ablation, axis, names, points):
    """A panel each for PSNR and critical PSNR, with a line per row: points(results of its seeds, key)."""
    return [
        plots.Panel(
            f"{title} against {axis}",
            axis,
            "dB, held-out views",
            {ablation.layout.names.get(name, name): points(ablation.results["own"][name], key) for name in names},
        )
        for title, key in list(qualities_of(ablation).items())[:2]
    ]


def over_time(ablation):
    """Quality at the moments of the first seed."""
    return panels_of(
        ablation,
        "seconds of training",
        trainings(ablation),
        lambda results, key: [(m["seconds"], m[key]) for m in results[0]["moments"]],
    )


def over_figure(figure, axis, unit=1):
    """Final quality against another figure, both as the mean of the seeds."""
    return lambda ablation: panels_of(
        ablation,
        axis,
        [name for name, results in ablation.results["own"].items() if results],
        lambda results, key: [(unit * mean_and_range(results, figure)[0], mean_and_range(results, key)[0])],
    )


def over_alpha(ablation):
    """Quality over alpha, for rows that differ in it only, with the row that has the default alpha."""
    panels = []
    for rest, rows in families(ablation.rows, "alpha=").items():
        title, rows = rest and f", {rest}", [*rows, *(row for row in ablation.rows if row.name == rest)]
        for kind, suffix in [("own", ""), ("equal", ", at equal count")]:
            results = ablation.results[kind]
            done = sorted([row for row in rows if results[row.name]], key=lambda row: row.alpha)
            if len(done) > 1:
                lines = {
                    q: [(row.alpha, mean_and_range(results[row.name], key)[0]) for row in done]
                    for q, key in qualities_of(ablation).items()
                }
                panels.append(
                    plots.Panel(f"Over alpha{suffix}{title}", "weight of semantics, alpha", "dB, held-out views", lines)
                )
    return panels


def over_rates(ablation):
    """Figures over the grid of pruning rates, for rows that differ in it only."""
    own, panels = ablation.results["own"], []
    figures = [
        *((f"{title}, dB", key, 1, 2) for title, key in list(qualities_of(ablation).items())[:2]),
        ("thousands of Gaussians", "gaussians", 1e-3, 1),
        ("processor seconds of training", "training_cpu_seconds", 1, 0),
    ]
    for rest, rows in families(ablation.rows, "rate=").items():
        title = rest and f", {rest}"
        for name, key, unit, decimals in figures if len(rows) > 1 else []:
            cells = {tuple(row.rates): unit * mean_and_range(own[row.name], key)[0] for row in rows}
            panels.append(
                plots.Panel(f"{name}{title}", "% pruned afterwards", "% pruned while densifying", cells, decimals)
            )
    return panels


EVERY_PANEL = [over_time, over_figure("pairs", "million pairs evaluated a frame", 1e-6), over_alpha, over_rates]


def write_plots(ablation):
    """Writes TABLE.svg. Returns False without matplotlib."""
    panels = [panel for of in ablation.layout.panels or EVERY_PANEL for panel in of(ablation)]
    text = plots.draw(panels)
    if text is None:
        ablation.progress.say(f"no {ablation.output}.svg: {plots.MISSING}")
        return False
    write(f"{ablation.output}.svg", text)
    return True


def families(rows, what):
    """Groups the rows that have a part beginning with `what` by the rest of their names; returns a dict of lists."""
    found = {}
    for row in rows:
        parts = row.name.split("+")
        rest = "+".join(part for part in parts if not part.startswith(what))
        if rest != row.name:
            found.setdefault(rest, []).append(row)
    return found
