# SPDX-License-Identifier: Apache-2.0
"""Writes the results of an ablation (ablation.py): TABLE.md for people, TABLE.csv and TABLE_curve.csv for programs,
and TABLE.svg if matplotlib is installed."""

import csv
import io
import math
import os

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
    "gaussians": ("Gaussians", 1, 0),
    "bytes": ("MB", 1e-6, 1),
    "training_seconds": ("training s", 1, 1),
    "training_cpu_seconds": ("CPU s", 1, 1),
    "beside": ("s / s beside", 1, 3),
    "peak_rss_bytes": ("peak MB", 1e-6, 0),
    "render_ms": ("render ms", 1, 2),
    "pairs": ("M pairs", 1e-6, 2),
}
QUALITIES = list(FIGURES)[:8]  # compared as a difference
RATIOS = ["gaussians", "training_seconds", "training_cpu_seconds", "render_ms", "pairs"]
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
    return f"{value:{sign}.{decimals}f}" if math.isfinite(value) else "-"


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

    def markdown(self):
        a = self.ablation
        page = f"# Ablation on {os.path.basename(a.dataset)}, {a.iterations} steps\n\n"
        page += (
            "Held-out views. PSNR in dB; C: critical, NC: not critical pixels; means of the seeds (largest less smallest in brackets). MB: the "
            "scene's files. Training: wall clock and processor time. Render, pairs: mean of a frame of the held-out views.\n\n"
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
        shown = [f for f in FIGURES if any(result[f] is not None for results in done.values() for result in results)]
        rows = []
        for name, results in done.items():
            rows.append([f"`{name}`"])
            for figure in shown:
                (mean, spread), (_, unit, decimals) = mean_and_range(results, figure), FIGURES[figure]
                brackets = f" ({spread * unit:.{decimals}f})" if math.isfinite(spread) else ""
                rows[-1].append(cell(mean * unit, decimals) + brackets)
        page = markdown_table(["row", *(FIGURES[f][0] for f in shown)], rows)
        if len(done) < 2:
            return page
        reference = "plain" if "plain" in done else next(iter(done))
        qualities, rows = [q for q in QUALITIES if q in shown], []
        for name, results in done.items():
            if name == reference:
                continue
            rows.append([f"`{name}`"])
            for figure in qualities:
                difference = mean_and_range(results, figure)[0] - mean_and_range(done[reference], figure)[0]
                none = abs(difference) <= self.spread(figure)
                rows[-1].append("none" if none else cell(difference, FIGURES[figure][2], "+"))
            for figure in RATIOS:
                mean, of = mean_and_range(results, figure)[0], mean_and_range(done[reference], figure)[0]
                rows[-1].append(f"{mean / of:.2f}x" if of else "-")
        return f"{page}\nAgainst `{reference}`:\n\n" + markdown_table(
            ["row", *(FIGURES[f][0] for f in [*qualities, *RATIOS])], rows
        )

    def equal_time(self):
        """Table of the quality that each row had reached when the fastest row finished, and at half of that time."""
        firsts = {name: results[0] for name, results in self.own.items() if results}
        if len(firsts) < 2:
            return ""
        end = min(result["training_seconds"] for result in firsts.values())
        heads = ["row", "PSNR, half", "PSNR", "PSNR-C, half", "PSNR-C", "PSNR-NC, half", "PSNR-NC"]
        rows = []
        for name, result in firsts.items():
            values = [quality_at(result["moments"], when, key) for key in OF_MOMENT for when in (end / 2, end)]
            rows.append([f"`{name}`", *(cell(value, 2) for value in values)])
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
            page += f"- `{row.name}`: {train}{evaluated}{'' if self.own[row.name] else '; not finished'}\n"
        return page


def quality_at(moments, seconds, key):
    """Quality after `seconds` of training, interpolated linearly between moments; NaN before the first moment."""
    number = [(m["seconds"], math.nan if m[key] is None else m[key]) for m in moments]
    for (t0, q0), (t1, q1) in zip([(math.nan, math.nan), *number], number):
        if t1 > seconds:
            return q0 + (q1 - q0) * (seconds - t0) / (t1 - t0)
    return number[-1][1]


# ---- Plots ----


def write_plots(ablation):
    """Writes TABLE.svg: quality against time; quality over alpha, and figures over a grid of pruning rates, for rows
    that differ in that part only. Returns False without matplotlib."""
    try:
        import matplotlib
    except ImportError:
        ablation.progress.say(
            f"no {ablation.output}.svg: the plot needs matplotlib, which this Python lacks (python3 -m pip install matplotlib)"
        )
        return False
    matplotlib.use("Agg")
    matplotlib.rcParams["svg.fonttype"] = "none"
    from matplotlib import pyplot

    own = ablation.results["own"]
    critical = any(math.isfinite(mean_and_range(results, "psnr_critical")[0]) for results in own.values())
    qualities = {"PSNR": "psnr", "PSNR, critical pixels": "psnr_critical", "PSNR, other pixels": "psnr_noncritical"}
    qualities = dict(list(qualities.items())[: 3 if critical else 1])
    panels = []
    for title, key in qualities.items():
        lines = {
            name: [(m["seconds"], m[key]) for m in results[0]["moments"]] for name, results in own.items() if results
        }
        panels.append((f"{title} against training time", "seconds of training", "dB, held-out views", lines))
    for title, key in qualities.items():
        lines = {
            name: [(1e-6 * result["pairs"], result[key]) for result in results]
            for name, results in own.items()
            if results
        }
        panels.append((f"{title} against pairs", "million pairs evaluated a frame", "dB, held-out views", lines))
    for title, rows in families(ablation.rows, "alpha=").items():
        for results, kind in [(own, ""), (ablation.results["equal"], ", at equal count")]:
            done = sorted([row for row in rows if results[row.name]], key=lambda row: row.alpha)
            if len(done) > 1:
                lines = {
                    q: [(row.alpha, mean_and_range(results[row.name], key)[0]) for row in done]
                    for q, key in qualities.items()
                }
                panels.append(
                    (
                        f"Over alpha{kind}{title}",
                        "alpha: the share of the semantic score",
                        "PSNR, dB, held-out views",
                        lines,
                    )
                )
    figures = [
        ("PSNR, dB", "psnr", 1, 2),
        ("PSNR of critical pixels, dB", "psnr_critical", 1, 2),
        ("thousands of Gaussians", "gaussians", 1e-3, 1),
        ("seconds of training", "training_seconds", 1, 0),
    ]
    for title, rows in families(ablation.rows, "rate=").items():
        for name, key, unit, decimals in figures if len(rows) > 1 else []:
            cells = {tuple(row.rates): unit * mean_and_range(own[row.name], key)[0] for row in rows}
            if key != "psnr_critical" or critical:
                panels.append((f"{name}{title}", "% pruned afterwards", "% pruned while densifying", (cells, decimals)))

    down = (len(panels) + 1) // 2
    figure = pyplot.figure(figsize=(14, 5 * down), layout="constrained")
    for number, (title, x_name, y_name, content) in enumerate(panels, 1):
        axes = figure.add_subplot(down, 2, number)
        axes.set(title=title, xlabel=x_name, ylabel=y_name)
        if isinstance(content, dict):
            for name, points in content.items():
                axes.plot(
                    [x for x, _ in points], [math.nan if y is None else y for _, y in points], marker=".", label=name
                )
            axes.legend(fontsize="small")
            continue
        cells, decimals = content
        soft, hard = (list(dict.fromkeys(rates[k] for rates in cells)) for k in (0, 1))
        axes.imshow([[cells.get((s, h), math.nan) for h in hard] for s in soft], aspect="auto")
        axes.set_xticks(range(len(hard)), hard)
        axes.set_yticks(range(len(soft)), soft)
        for (s, h), value in cells.items():
            axes.text(
                hard.index(h), soft.index(s), cell(value, decimals), ha="center", va="center", backgroundcolor="white"
            )
    text = io.StringIO()
    figure.savefig(text, format="svg")
    pyplot.close(figure)
    write(f"{ablation.output}.svg", text.getvalue())
    return True


def families(rows, what):
    """Groups the rows that have a part beginning with `what` by the rest of their names; returns a dict of lists."""
    found = {}
    for row in rows:
        parts = row.name.split("+")
        rest = "+".join(part for part in parts if not part.startswith(what))
        if rest != row.name:
            found.setdefault(f", {rest}" if rest else "", []).append(row)
    return found
