#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Ablation: trains one data set once for each row of a table, the rows differing in one option or a few, and compares held-out quality,
size, training and rendering time, at each row's own count, at equal training time and at equal count (docs/priority.md).

Rows with the same training options share a run, which is a folder of TABLE.runs (--runs) named by the options:
  scene/                    the scene that pags train writes
  run.json                  the step reached, the time spent, and the moments (measured intermediate states)
  known_STEP.pags           the checkpoint of the step in run.json, a link to the former scene/checkpoint.pags; rows
                            that are compared at equal count also keep the earlier ones, and after the end the last
                            one before the last prune
  eval*.json, render*_N.json  reports of pags eval and pags render on the finished scene; a frame's time is the
                            shortest of RENDERS
A run is trained in stretches between moments. The time of a stretch is known once pags train has reported it, at its
end or when it was interrupted. A stretch that ended without a report is trained again from known_STEP.pags, so that
the table's times are complete."""

import argparse
import ctypes
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import zipfile

from ablation_tables import OF_MOMENT, QUALITIES, Layout, Tables, write, write_plots

MOST_SEEDS, MOST_MOMENTS, RENDERS = 16, 64, 3
PROGRAM = os.path.basename(sys.argv[0])
SPR = "--preset paper --alpha 0.4 --prune-rate 0.6/0.3 --set dropout=1 --set dropout_beta=0.5"
WHOLE = {
    "default": "",
    "plain": "--preset plain",
    "paper": "--preset paper",
    "sp": "--preset paper --alpha 0 --set dropout=0",
    "sd": "--preset plain --set dropout=1 --set dropout_beta=0",
    "sp&sd": "--preset paper --alpha 0 --set dropout=1 --set dropout_beta=0",
    "spr": SPR,
}
# Each of these changes one option of spr, or of another whole row if the row names one.
CHANGES = {
    "alpha": "--alpha",
    "rate": "--prune-rate",
    "preset": "--preset",
    "beta": "--set dropout_beta",
    "gamma": "--set dropout_gamma",
    "critical-weight": "--critical-weight",
    "score": "--set score",
}
# How a row is rendered; the training is that of the row's other parts.
RENDERED = {"pdr": ("--early-z", "paper"), "paper-order": ("--order", "paper")}
SWITCHES = {
    "no-objects": "--no-objects",
    "no-tracks": "--no-tracks",
    "no-fourier": "--set fourier=0",
    "no-sky": "--no-sky",
    "no-lidar-start": "--no-lidar-start",
    "no-exposure": "--no-exposure",
    "no-lidar-loss": "--set depth_weight=0",
    "no-camera-poses": "--set camera_poses=0",
    "no-light": "--set light=0",
    # each of these takes one part of the default away
    "no-alpha-min": "--set alpha_min=0",
    "no-scale-reset": "--set scale_reset=1",
    "no-prunes": "--set prunes=0",
    "no-rates": "--set position_rate_begin=0.00016 --set position_rate_end=1.6e-6 --set scale_rate=0.005 --set sh_dc_rate=0.0025 "
    "--set sh_rest_rate=0.000125",
    "no-rate-fall": "--set rate_fall=1",
    "no-ssim": "--set ssim_weight=0.2",
    "no-few-points": "--set lidar_points=200000",
    "no-slow-growth": "--set densify_gradient=0.0002 --set densify_apart=1",
    "no-long-axis": "--set long_axis_split=0",
    "no-critical-weight": "--critical-weight 1",
}
# Options that apply to every row. They are passed to pags train; True: to pags eval, too, since the scene doesn't
# record them.
PASSED = {
    "downscale": False,
    "split-every": False,
    "cameras": False,
    "frames": False,
    "holdout-camera": False,
    "max-gaussians": False,
    "kind": True,
    "ego-mask": True,
    "sfm": True,
    "colmap": True,
    "critical": True,
}


class Failure(Exception):
    pass


class Interrupted(Exception):
    pass


# ---- Rows ----


class Options:
    """Options of pags by name. An option given again replaces the earlier one; each NAME of --set NAME=VALUE counts
    as an option of its own."""

    def __init__(self):
        self.given = {}

    def put(self, name, value=None):
        key = f"--set {value.split('=')[0]}" if name == "--set" and value else name
        self.given[key] = [name] if value is None else [name, value]

    def put_text(self, text):
        for option in text.split("--")[1:]:
            self.put(*f"--{option}".split())

    def words(self):
        return [word for words in self.given.values() for word in words]

    def file_name(self):
        """The options as a file name, such as preset-paper_alpha-0.4."""
        return "_".join("-".join([words[0][2:], *words[1:]]) for words in self.given.values())


def safe_name(name):
    return re.sub(r"[^A-Za-z0-9._-]", "_", name)


class Row:
    """A row of the table. Its name is a list of parts joined by '+', which determine all of its options."""

    def __init__(self, text, seeds):
        name, star, repeats = text.partition("*")
        if not name:
            raise Failure(f"'{text}': expected the name of a row")
        if star and not (repeats.isdecimal() and 1 <= int(repeats) <= MOST_SEEDS):
            raise Failure(f"row '{name}': expected NAME*SEEDS, 1 to {MOST_SEEDS} seeds")
        self.name, self.seeds = name, int(repeats) if star else seeds
        self.train, self.eval = Options(), Options()
        self.alpha, self.rates = 0.4, None  # the default of --alpha
        parts = name.replace("sp+sd", "sp&sd").split("+")
        if any(p.partition("=")[0] in CHANGES for p in parts) and not any(p in WHOLE for p in parts):
            self.train.put_text(SPR)
        for part in parts:
            self.add(part)
        self.prunes = (
            self.train.given.get("--preset", ["", "default"])[1] != "plain" and "prunes=0" not in self.train.words()
        )

    def add(self, part):
        key, equals, value = part.partition("=")
        if part.startswith("set:"):
            self.train.put("--set", part[4:])
        elif part.startswith("--"):
            self.train.put(key, value if equals else None)
        elif part in WHOLE:
            self.train.put_text(WHOLE[part])
        elif part in RENDERED:
            self.eval.put(*RENDERED[part])
        elif part in SWITCHES:
            self.train.put_text(SWITCHES[part])
        elif not equals or key not in [*CHANGES, "sh"]:
            known = ", ".join([*WHOLE, *RENDERED, *(f"{c}=..." for c in CHANGES), *SWITCHES, "sh=..."])
            raise Failure(
                f"row '{self.name}': '{part}' is none of {known}, nor an option of pags train (--NAME=VALUE, set:NAME=VALUE)"
            )
        elif not value:
            raise Failure(f"row '{self.name}': expected a value behind '{part}'")
        elif key == "sh":
            self.train.put("--sh-degree", value)
        else:
            option, _, field = CHANGES[key].partition(" ")
            value = self.checked(key, value)
            self.train.put(option, f"{field}={value}" if field else value)

    def checked(self, key, value):
        if key == "alpha":
            try:
                self.alpha = float(value)
            except ValueError:
                raise Failure(f"row '{self.name}': expected a number behind {key}={value}") from None
        if key == "rate":
            try:
                rates = [float(word) for word in value.split("/")]
            except ValueError:
                rates = []
            if len(rates) != 2 or not all(0 <= rate < 100 for rate in rates):
                raise Failure(f"row '{self.name}': expected per cent of both kinds of pruning, as in rate=60/30")
            self.rates = [f"{rate:g}" for rate in rates]
            return "/".join(f"{rate / 100:g}" for rate in rates)
        return value


def parse_rows(text, seeds):
    rows = []
    for word in text.split(","):
        rows.append(Row(word, seeds))
        if any(row.name == rows[-1].name for row in rows[:-1]):
            raise Failure(f"row '{rows[-1].name}' is named twice")
    return rows


# ---- Files and processes ----


def read_json(path):
    with open(path, encoding="utf-8") as file:
        return json.load(file)


def link(source, target):
    if os.path.lexists(target):
        os.unlink(target)
    try:
        os.link(source, target)
    except OSError:  # this file system has no hard links
        shutil.copy2(source, f"{target}.part")
        os.replace(f"{target}.part", target)


def network_of(weights):
    """The network of LPIPS weights, as pags eval reports it; None for other files, which pags eval then rejects."""
    try:
        names = zipfile.ZipFile(weights).namelist()
    except (OSError, zipfile.BadZipFile):
        return None
    return "SqueezeNet 1.1" if any(name.startswith("fire") for name in names) else "AlexNet"


def cpu_seconds():
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def die_with_parent():
    """Linux: the child gets SIGTERM when this process dies."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGTERM)


class Program:
    """Runs pags, one process at a time. The first SIGINT or SIGTERM is passed on to the process, which saves its
    state and stops; a second SIGINT ends this program."""

    def __init__(self, path):
        self.path, self.child, self.interrupted = path, None, False
        for number in [signal.SIGINT, signal.SIGTERM]:
            signal.signal(number, self.on_signal)

    def on_signal(self, number, _):
        if self.interrupted and number == signal.SIGINT:
            os._exit(128 + number)
        self.interrupted = True
        if self.child:
            self.child.terminate()

    def run(self, words, on_line=None):
        """Runs pags with these arguments; returns its exit code, the last line of its stderr, and the processor
        seconds."""
        before = cpu_seconds()
        if self.interrupted:
            raise Interrupted
        with tempfile.TemporaryFile("w+", errors="replace") as errors:
            out = subprocess.PIPE if on_line else subprocess.DEVNULL
            # In a session of its own, so that Ctrl-C on the terminal doesn't reach the process twice.
            with subprocess.Popen(
                [self.path, *words],
                stdout=out,
                stderr=errors,
                text=True,
                start_new_session=True,
                preexec_fn=die_with_parent,
            ) as self.child:
                if self.interrupted:
                    self.child.terminate()
                for line in self.child.stdout or []:
                    on_line(line.rstrip("\n"))
                code = self.child.wait()
            self.child = None
            errors.seek(0)
            said = errors.read().strip().splitlines()
        message = f"killed by signal {-code}" if code < 0 else said[-1].removeprefix("pags: ") if said else "no message"
        return code, message, cpu_seconds() - before


class Progress:
    """Prints progress lines. On a terminal, a line that doesn't stay is overwritten by the next one."""

    def __init__(self, stream):
        self.stream, self.width = stream, 0

    def clear(self):
        if self.width:
            print("\r" + " " * self.width, end="\r", file=self.stream, flush=True)
        self.width = 0

    def say(self, line, stays=True):
        if not self.stream:
            return
        self.clear()
        passing = not stays and self.stream.isatty()
        self.width = len(line) if passing else 0
        print(line, end="" if passing else "\n", file=self.stream, flush=True)


def duration(seconds):
    whole = max(0, round(seconds))
    if whole >= 3600:
        return f"{whole // 3600} h {whole // 60 % 60:02} min"
    return f"{whole // 60} min {whole % 60:02} s" if whole >= 60 else f"{whole} s"


# ---- One training ----


class Run:
    """The training of a row with one seed, at most `bound` Gaussians (equal count), and its evaluation. `of`: the row with which this one is
    trained, for its time alone."""

    def __init__(self, ablation, row, seed, bound=None, of=None):
        self.ablation, self.row, self.seed = ablation, row, str(ablation.seed + seed)
        self.train = Options()
        self.train.given = dict(row.train.given)
        if bound:
            self.train.put("--max-gaussians", str(bound))
        self.folder = os.path.join(
            ablation.folder,
            safe_name(
                "_".join(filter(None, [self.train.file_name(), f"seed-{self.seed}", of and f"beside_{of.name}"]))
            ),
        )
        self.scene, self.checkpoint, self.state_path = (
            self.path("scene"),
            self.path("scene/checkpoint.pags"),
            self.path("run.json"),
        )
        self.state = {"step": 0, "seconds": 0, "cpu_seconds": 0, "peak_rss_bytes": 0, "moments": []}
        if os.path.exists(self.state_path):
            self.state = read_json(self.state_path)
        self.moments = self.state["moments"]

    def path(self, name):
        return os.path.join(self.folder, name)

    def known(self, step):
        return self.path(f"known_{step}.pags")

    def save(self):
        write(self.state_path, json.dumps(self.state, indent=1) + "\n")

    def call(self, words):
        """Runs pags; an error names the row. Returns the seconds of processor time, and False where it was interrupted."""
        on_line = (lambda line: self.ablation.show(self, line)) if self.ablation.progress.stream else None
        code, message, seconds = self.ablation.program.run([str(word) for word in words], on_line)
        if code and not self.ablation.program.interrupted:
            raise Failure(f"row '{self.row.name}', seed {self.seed}: pags {words[0]}: {message} (exit code {code})")
        return seconds, code == 0

    def train_stretch(self):
        """Trains to the next moment from the known checkpoint; steps that an earlier training made beyond it are
        discarded."""
        a, report = self.ablation, self.path("train.json")
        target = a.iterations * (len(self.moments) + 1) // a.moments
        if self.state["step"] == 0:
            shutil.rmtree(self.scene, ignore_errors=True)
        else:
            os.makedirs(self.scene, exist_ok=True)
            link(self.known(self.state["step"]), self.checkpoint)
        if os.path.exists(report):
            os.unlink(report)
        words = [
            "train",
            a.dataset,
            "--output",
            self.scene,
            "--iterations",
            target,
            "--set",
            f"schedule_iterations={a.iterations}",
            "--resume",
        ]
        words += [
            "--checkpoint-every",
            0,
            "--preview-every",
            0,
            "--json",
            report,
            "--seed",
            self.seed,
            "--threads",
            a.threads,
        ]
        seconds, whole = self.call([*words, *a.train, *self.train.words()])
        if os.path.exists(report):
            self.take_report(read_json(report), seconds, target)
        if not whole:
            raise Interrupted

    def take_report(self, report, seconds, target):
        state, step, last = self.state, report["iterations"], self.state["step"]
        self.ablation.steps_done += step - last
        self.ablation.steps_told = 0
        state["seconds"] += report["seconds"]
        state["cpu_seconds"] += seconds
        state["peak_rss_bytes"] = max(state["peak_rss_bytes"], report["peak_rss_bytes"])
        if step == target:
            spent = {key: state[key] for key in ["seconds", "cpu_seconds", "peak_rss_bytes"]}
            self.moments.append({"step": step, "gaussians": report["gaussians"], **spent, **dict.fromkeys(OF_MOMENT)})
        if step == 0:
            return
        link(
            self.checkpoint, self.known(step)
        )  # pags train renames checkpoints into place, so the link keeps its bytes
        state["step"] = step
        self.save()
        if last not in (0, step) and not (self.ablation.equal and self.row.prunes):
            os.unlink(self.known(last))

    def measure(self, verb, path, more):
        """Runs pags eval or render on the held-out views; the report file exists only if it is complete."""
        if not self.call(
            [verb, self.scene, "--split", "test", "--json", path, "--threads", self.ablation.threads, *more]
        )[1]:
            raise Interrupted

    def measure_moment(self):
        path = self.path("moment.json")
        self.measure("eval", path, ["--views", self.ablation.moment_views, *self.ablation.eval])
        found = read_json(path).get("test", {})
        if found.get("psnr") is None:
            raise Failure(f"{self.ablation.dataset}: expected held-out views to compare with")
        self.moments[-1].update({key: found.get(key) for key in OF_MOMENT})
        os.unlink(path)
        self.save()

    def go_on(self):
        """Does the missing training and measurements of the run; returns its result."""
        os.makedirs(self.folder, exist_ok=True)
        while True:
            if self.moments and self.moments[-1]["psnr"] is None:
                self.measure_moment()
            elif len(self.moments) < self.ablation.moments:
                self.train_stretch()
            else:
                return self.finish()

    def seconds(self):
        """Does the training as go_on does, without measurements; returns its seconds."""
        os.makedirs(self.folder, exist_ok=True)
        while len(self.moments) < self.ablation.moments:
            self.train_stretch()
        if os.path.exists(self.scene):
            shutil.rmtree(self.scene)
        if os.path.exists(self.known(self.state["step"])):
            os.unlink(self.known(self.state["step"]))
        return self.moments[-1]["seconds"]

    def finish(self):
        a, more = self.ablation, "_".join(["", self.row.eval.file_name()]) if self.row.eval.given else ""
        evaluation, pictures = self.path(f"eval{more}.json"), self.path("pictures")
        renders = [self.path(f"render{more}_{i}.json") for i in range(1, RENDERS + 1)]
        lpips = ["--lpips-weights", a.lpips_weights] if a.lpips_weights else []
        if not os.path.exists(evaluation) or (lpips and read_json(evaluation).get("lpips_network") != a.lpips_network):
            self.measure("eval", evaluation, [*lpips, *a.eval, *self.row.eval.words()])
        for render in [path for path in renders if not os.path.exists(path)]:
            try:
                self.measure("render", render, ["--output", pictures, *self.row.eval.words()])
            finally:
                shutil.rmtree(pictures, ignore_errors=True)
        found, last, network = (
            read_json(evaluation)["test"],
            self.moments[-1],
            read_json(evaluation).get("lpips_network"),
        )
        frames = list(zip(*(read_json(path)["frames"] for path in renders)))
        milliseconds = sum(min(pass_["ms"]["total"] for pass_ in frame) for frame in frames) / len(frames)
        result = {key: found.get(key) for key in QUALITIES}
        result.update(
            beside=None,
            lpips_network=network,
            depth=(found.get("depth") or {}).get("mean_95"),
            pairs=sum(frame[0]["pairs_evaluated"] for frame in frames) / len(frames),
            gaussians=last["gaussians"],
            bytes=self.scene_bytes(),
            training_seconds=last["seconds"],
            training_cpu_seconds=last["cpu_seconds"],
            peak_rss_bytes=last["peak_rss_bytes"],
            render_ms=milliseconds,
            fps=1000 / milliseconds,
            moments=self.moments,
        )
        branch = self.branch()
        for name in os.listdir(self.folder):
            if name.startswith("known_") and not (branch and name == f"known_{branch['step']}.pags"):
                os.unlink(self.path(name))
        if os.path.exists(self.checkpoint):
            os.unlink(self.checkpoint)
        return result

    def scene_bytes(self):
        """Bytes of the scene's files that rendering needs, without log, reports, previews and checkpoint."""
        total = 0
        for folder in [self.scene, os.path.join(self.scene, "objects")]:
            for name in os.listdir(folder) if os.path.isdir(folder) else []:
                if name == "scene.json" or name.endswith((".ply", ".npy", ".npz")):
                    total += os.path.getsize(os.path.join(folder, name))
        return total

    def branch(self):
        """The last moment before the last prune by score whose checkpoint exists, from which a run with another bound
        on the number of Gaussians continues; None if there is no limit."""
        log, prune = os.path.join(self.scene, "log.jsonl"), 0
        if os.path.exists(log):
            with open(log, encoding="utf-8") as file:
                for line in file:
                    if '"pruned_by_score"' in line:
                        prune = json.loads(line)["step"]
        kept = [m for m in self.moments if m["step"] < prune and os.path.exists(self.known(m["step"]))]
        return kept[-1] if kept else None

    def branch_off(self, source):
        """Starts this run from the state of the run `source` before its last prune."""
        moment = source.branch()
        if not moment or os.path.exists(self.state_path):
            return
        os.makedirs(self.folder, exist_ok=True)
        self.moments[:] = [m for m in source.moments if m["step"] <= moment["step"]]
        self.state.update({key: moment[key] for key in ["step", "seconds", "cpu_seconds", "peak_rss_bytes"]})
        link(source.known(moment["step"]), self.known(moment["step"]))
        self.save()


# ---- All of them ----


class Ablation:
    def __init__(self, given, rest, layout):
        self.dataset = os.path.realpath(given.dataset)
        self.output = given.output.removesuffix(".md")
        self.folder, self.layout = given.runs or f"{self.output}.runs", layout
        self.program = Program(given.pags)
        self.rows = parse_rows(given.rows, given.seeds)
        self.results = {"own": {row.name: [] for row in self.rows}, "equal": {row.name: [] for row in self.rows}}
        self.iterations, self.moments, self.moment_views, self.seed = (
            given.iterations,
            given.moments,
            given.moment_views,
            given.seed,
        )
        self.equal, self.equal_count = given.equal_count, 0
        self.beside = Row(given.beside, 1) if given.beside else None
        self.lpips_weights, self.threads = given.lpips_weights, given.threads
        self.lpips_network = given.lpips_weights and network_of(given.lpips_weights)
        self.train, self.eval = [], []
        for name, of_eval in PASSED.items():
            value = getattr(given, name.replace("-", "_"))
            if value is not None:
                self.train += [f"--{name}", value]
                self.eval += [f"--{name}", value] if of_eval else []
        self.train += rest
        self.progress = Progress(None if given.quiet else sys.stderr if given.json == "-" else sys.stdout)
        self.steps_wanted = self.steps_done = self.steps_begun = self.steps_told = 0
        self.plotted = True

    def check_rows(self):
        """Lets pags check the options of every row; raises Failure if it rejects one."""
        for row in [*self.rows, *filter(None, [self.beside])]:
            train = ["train", self.dataset, "--output", self.folder, *self.train, *row.train.words()]
            for words in [train, ["eval", self.folder, *self.eval, *row.eval.words()]]:
                code, message, _ = self.program.run([*words, "--check-options"])
                if code:
                    raise Failure(f"row '{row.name}': {message}")

    def check_settings(self):
        """Compares the settings that all rows share with those recorded in the folder of runs, since only runs with
        equal settings can be compared; records them in a new folder."""
        path = os.path.join(self.folder, "settings.json")
        settings = {
            key: getattr(self, key) for key in ["dataset", "iterations", "moments", "moment_views", "train", "eval"]
        }
        if not os.path.exists(path):
            write(path, json.dumps(settings, indent=1) + "\n")
        elif read_json(path) != settings:
            raise Failure(
                f"{path}: the runs there have another data set or other options; expected the same, or another -o"
            )

    def run_beside(self, row, seed):
        """The reference run (--beside) trained for a row; None without it, and for the row that is the same training."""
        return (
            Run(self, self.beside, seed, of=row)
            if self.beside and row.train.words() != self.beside.train.words()
            else None
        )

    def count_steps(self):
        pairs = [(row, seed) for row in self.rows for seed in range(row.seeds)]
        runs = {run.folder: run for pair in pairs for run in (Run(self, *pair), self.run_beside(*pair)) if run}
        self.steps_wanted = len(runs) * self.iterations
        self.steps_done = self.steps_begun = sum(run.state["step"] for run in runs.values())
        self.begun = time.monotonic()

    def show(self, run, line):
        at = re.match(r"(step|view) (\d+) of \d+", line)
        if not at:
            return
        if at[1] == "step":
            self.steps_told = int(at[2]) - run.state["step"]
        done = self.steps_done + self.steps_told - self.steps_begun
        left = self.steps_wanted - self.steps_done - self.steps_told
        rest = duration(left * (time.monotonic() - self.begun) / done) if done > 0 else "not yet known"
        number = [row.name for row in self.rows].index(run.row.name) + 1
        self.progress.say(
            f"row {number} of {len(self.rows)} ({run.row.name}, seed {run.seed}): {line}; {rest} for all", False
        )

    def take(self, kind, row, seed, result):
        self.results[kind][row.name].append({"row": row.name, "seed": self.seed + seed, **result})
        regions = ""
        if result["psnr_critical"] is not None and result["psnr_noncritical"] is not None:
            regions = f" (critical {result['psnr_critical']:.2f}, other {result['psnr_noncritical']:.2f})"
        self.progress.say(
            f"{row.name:16} seed {self.seed + seed}{' at equal count' if kind == 'equal' else ''}: PSNR {result['psnr']:.2f} dB{regions}, "
            f"{result['gaussians']} Gaussians, {result['training_seconds']:.0f} s, {result['render_ms']:.2f} ms a frame"
        )
        Tables(self).write()
        self.plotted = self.plotted and write_plots(self)

    def run(self):
        """Runs all rows, seed by seed, so that a table of all rows with the first seed exists early; then, with
        --equal-count, the pruning rows at equal count."""
        self.count_steps()
        order = [(seed, row) for seed in range(MOST_SEEDS) for row in self.rows if seed < row.seeds]
        for seed, row in order:
            beside = self.run_beside(row, seed)
            seconds = beside and beside.seconds()
            result = Run(self, row, seed).go_on()
            self.take("own", row, seed, {**result, "beside": result["training_seconds"] / seconds if seconds else None})
        pruned = [row for row in self.rows if row.prunes]
        if self.equal and len({tuple(row.train.words()) for row in pruned}) < 2:
            self.progress.say("--equal-count: fewer than two rows prune by a score")
        elif self.equal:
            self.equal_count = min(result["gaussians"] for row in pruned for result in self.results["own"][row.name])
            for seed, row in [(seed, row) for seed, row in order if row.prunes]:
                own = self.results["own"][row.name][seed]
                if own["gaussians"] == self.equal_count:  # the same run
                    self.take("equal", row, seed, own)
                    continue
                bounded = Run(self, row, seed, self.equal_count)
                bounded.branch_off(Run(self, row, seed))
                self.take("equal", row, seed, bounded.go_on())
        self.progress.say(
            ", ".join(self.output + end for end in [".md", ".csv", "_curve.csv", *([".svg"] if self.plotted else [])])
        )

    def json(self):
        def flat(kind):
            return [result for row in self.rows for result in self.results[kind][row.name]]

        return (
            json.dumps({"rows": flat("own"), "equal_count": self.equal_count, "equal_rows": flat("equal")}, indent=2)
            + "\n"
        )


# ---- Command line ----


RESUMED = "Ctrl-C stops with everything saved; the same command resumes it. Any other option of pags train follows --, at the end."


class Parser(argparse.ArgumentParser):
    def error(self, message):
        self.exit(2, f"{self.prog}: {message}; '{self.prog} --help' lists the options\n")


def whole(least, most=2**63 - 1):
    def parse(text):
        value = int(text)
        if not least <= value <= most:
            raise argparse.ArgumentTypeError(f"expected a whole number from {least} to {most}, got '{text}'")
        return value

    parse.__name__ = "whole number"
    return parse


def common_options():
    """The options that all programs with tables of trainings have."""
    built = os.path.join(os.path.dirname(os.path.abspath(__file__)), "../build/pags")
    p = argparse.ArgumentParser(add_help=False)
    p.add_argument(
        "-n",
        "--iterations",
        type=whole(1),
        default=5000,
        metavar="N",
        help="steps of each training [default %(default)s]",
    )
    p.add_argument(
        "--seeds",
        type=whole(1, MOST_SEEDS),
        default=1,
        metavar="K",
        help="repeat each row with K seeds [default %(default)s]",
    )
    p.add_argument("--seed", type=whole(0), default=0, metavar="N", help="the first seed [default %(default)s]")
    p.add_argument(
        "--moments",
        type=whole(1, MOST_MOMENTS),
        default=8,
        metavar="N",
        help="measure held-out quality N times, evenly over the steps [default %(default)s]",
    )
    p.add_argument(
        "--moment-views",
        type=whole(1, 10**6),
        default=12,
        metavar="N",
        help="on N held-out views [default %(default)s]",
    )
    p.add_argument("--lpips-weights", metavar="FILE", help="as for pags eval [default: AlexNet's, if installed]")
    for name in PASSED:
        p.add_argument(f"--{name}", metavar="VALUE", help="for every row, as for pags train")
    p.add_argument(
        "-j",
        "--threads",
        type=whole(0, 256),
        default=0,
        metavar="N",
        help="threads [default: as affinity and cgroup allow]",
    )
    p.add_argument("--json", metavar="FILE|-", help="write the results as JSON to FILE, or to standard output")
    p.add_argument("-q", "--quiet", action="store_true", help="print nothing but errors")
    p.add_argument(
        "--pags", default=os.path.normpath(built), metavar="PROGRAM", help="the program pags [default build/pags]"
    )
    p.add_argument("--check-options", action="store_true", help="check rows and options, do nothing")
    return p


def parse_words(p, words):
    """Parses the program's options; returns them and the options of pags train that follow --."""
    at = words.index("--") if "--" in words else len(words)
    given = p.parse_args(words[:at])
    if given.moments > given.iterations:
        p.error("--moments: expected at most --iterations")
    return given, words[at + 1 :]


def parse_arguments(words):
    words = list(words)
    if "--rows" in words[:-1]:  # rows may begin with dashes
        at = words.index("--rows")
        words[at : at + 2] = [f"--rows={words[at + 1]}"]
    p = Parser(
        PROGRAM, allow_abbrev=False, parents=[common_options()], description=__doc__.split("\n\n")[0], epilog=RESUMED
    )
    p.add_argument("dataset", metavar="DATASET", help="as for pags train")
    p.add_argument(
        "-o",
        "--output",
        metavar="TABLE",
        required=True,
        help="write TABLE.md, TABLE.csv, TABLE_curve.csv and TABLE.svg after every row",
    )
    p.add_argument("--runs", metavar="FOLDER", help="keep the trainings in FOLDER [default TABLE.runs]")
    p.add_argument(
        "--rows",
        default="plain,sp,sd,sp+sd,spr,plain+pdr,spr+pdr,default",
        metavar="NAME,...",
        help="rows of the table; NAME*K: with K seeds; parts joined by +, later ones win (docs/priority.md); any option of "
        "pags train: --NAME=VALUE or set:NAME=VALUE [default %(default)s]",
    )
    p.add_argument(
        "--equal-count",
        action="store_true",
        help="compare rows that prune at equal count, too: the smallest of their counts",
    )
    p.add_argument(
        "--beside",
        metavar="ROW",
        help="train ROW once more just before each row, and give the ratio of both times: for machines whose speed changes",
    )
    return parse_words(p, words)


def make_table(given, rest, layout):
    """Makes the table or resumes it; with --check-options only checks the rows."""
    table = Ablation(given, rest, layout)
    table.check_rows()
    if given.check_options:
        return table
    os.makedirs(table.folder, exist_ok=True)
    table.check_settings()
    try:
        table.run()
    finally:
        table.progress.clear()
    if given.json == "-":
        sys.stdout.write(table.json())
    elif given.json:
        write(given.json, table.json())
    return table


def exit_code_of(action):
    """Exit code of the action: 3 where it was interrupted, 1 where it failed, each with a line that says so."""
    try:
        action()
        return 0
    except Interrupted:
        code, message = 3, "interrupted; the same command resumes from here"
    except (Failure, OSError) as error:
        code, message = 1, error
        if isinstance(error, OSError) and error.filename:
            message = f"{error.filename}: {error.strerror}"
    print(f"{PROGRAM}: {message}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(exit_code_of(lambda: make_table(*parse_arguments(sys.argv[1:]), Layout())))
