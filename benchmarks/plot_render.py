#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""plot_render.py RESULTS.json [PLOT.svg|png|pdf]: plots what `pags-bench render --json RESULTS.json` measured: frame time along the path,
largest error and PSNR against speed-up, one row of panels per picture size. Requires matplotlib. Default output: RESULTS.svg."""

import json
import os
import sys


def main():
    if len(sys.argv) not in (2, 3) or sys.argv[1] in ("-h", "--help"):
        sys.exit(__doc__)
    try:
        import matplotlib
    except ImportError:
        sys.exit("plot_render: matplotlib is not installed; run: pip install matplotlib")
    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    output = sys.argv[2] if len(sys.argv) == 3 else os.path.splitext(sys.argv[1])[0] + ".svg"
    with open(sys.argv[1], encoding="utf-8") as file:
        sizes = json.load(file)["sizes"]
    figure, panels = plt.subplots(len(sizes), 3, figsize=(15, 4.5 * len(sizes)), squeeze=False, layout="constrained")
    for size, (time, error, psnr) in zip(sizes, panels):
        for mode in size["modes"]:
            name = mode["mode"]
            time.plot(mode["frame_ms"], label=name)
            error.plot(mode["speed_up"], mode["max_error"], "o", label=name)
            psnr.plot(mode["speed_up"], 100 if mode["psnr"] is None else min(mode["psnr"], 100), "o", label=name)
        where = f"{size['width']}x{size['height']}"
        time.set(title=f"Frame time along the path, {where}", xlabel="picture", ylabel="ms (median)", ylim=(0, None))
        error.set(title=f"Largest error, {where}", xlabel="speed-up", ylabel="colour, 0 to 1", ylim=(0, None))
        psnr.set(title=f"PSNR, {where} (100: no error)", xlabel="speed-up", ylabel="dB")
        time.legend()
    figure.savefig(output)


if __name__ == "__main__":
    main()
