# SPDX-License-Identifier: Apache-2.0
"""Draws the plots of the benchmarks with matplotlib, which `make setup` puts into benchmarks/.venv."""

import glob
import io
import math
import os
import sys
from typing import NamedTuple

# Okabe and Ito's colours, which colour-blind readers can tell apart, without yellow, which is too pale for lines. With
# eight markers, 56 lines differ.
COLOURS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000"]
MARKERS = "osDv^<>P"
MISSING = "plots need matplotlib; 'make setup' installs it into benchmarks/.venv"


def pyplot():
    """matplotlib.pyplot, without a window and with the style of these plots; None where matplotlib is missing."""
    here = os.path.dirname(os.path.abspath(__file__))
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    sys.path += set(glob.glob(f"{here}/.venv/lib/{version}/site-packages")) - set(sys.path)
    try:
        import matplotlib
    except ImportError:
        return None
    matplotlib.use("Agg")
    matplotlib.rcParams.update(
        {
            # Text as text keeps an SVG small. The salt and no date keep its bytes the same.
            "svg.fonttype": "none",
            "svg.hashsalt": "pags",
            "font.sans-serif": ["DejaVu Sans"],
            "axes.prop_cycle": matplotlib.cycler(marker=list(MARKERS * 7), color=COLOURS * 8),
            "axes.grid": True,
            "grid.color": "#dddddd",
            "axes.axisbelow": True,
            "image.cmap": "cividis",
            "figure.constrained_layout.use": True,
        }
    )
    from matplotlib import pyplot

    return pyplot


class Panel(NamedTuple):
    """`content`: lines, as {name: [(x, y), ...]}, or a grid, as {(row, column): value} with `decimals`."""

    title: str
    x: str
    y: str
    content: dict
    decimals: int = 0


def draw_lines(axes, lines, names):
    for name, points in lines.items():
        numbers, style = [(x, math.nan if y is None else y) for x, y in points], names.index(name)
        colour, marker = COLOURS[style % len(COLOURS)], MARKERS[style % len(MARKERS)]
        axes.plot(*zip(*numbers), color=colour, marker=marker, markersize=5, label=name)


def draw_grid(axes, cells, decimals):
    down, across = (list(dict.fromkeys(at[k] for at in cells)) for k in (0, 1))
    image = axes.imshow([[cells.get((d, a), math.nan) for a in across] for d in down], aspect="auto")
    axes.set_xticks(range(len(across)), across)
    axes.set_yticks(range(len(down)), down)
    axes.grid(False)
    for (d, a), value in cells.items():
        text = f"{value:.{decimals}f}" if math.isfinite(value) else "-"
        dark = math.isfinite(value) and image.norm(value) < 0.5
        axes.text(across.index(a), down.index(d), text, ha="center", va="center", color="white" if dark else "black")


def draw(panels, across=2):
    """The panels, `across` in a row, as the text of an SVG file; None where matplotlib is missing. Lines of the
    same name have the same style in all panels, and one legend names them."""
    plot = pyplot()
    if not plot:
        return None
    down, labels = -(-len(panels) // across), {}
    lines = [panel.content for panel in panels if not isinstance(next(iter(panel.content), None), tuple)]
    names = list(dict.fromkeys(name for content in lines for name in content))
    figure = plot.figure(figsize=(4.5 * across, 3.4 * down))
    for number, panel in enumerate(panels, 1):
        axes = figure.add_subplot(down, across, number)
        axes.set(title=panel.title, xlabel=panel.x, ylabel=panel.y)
        if panel.content not in lines:
            draw_grid(axes, panel.content, panel.decimals)
        else:
            draw_lines(axes, panel.content, names)
            labels.update((line.get_label(), line) for line in axes.get_lines())
    if labels:
        figure.legend(labels.values(), labels.keys(), loc="outside lower center", ncols=4, fontsize="small")
    return svg(figure)


def svg(figure):
    """The figure as the text of an SVG file; closes the figure."""
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata={"Date": None})
    pyplot().close(figure)
    return text.getvalue()
