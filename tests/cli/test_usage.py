# SPDX-License-Identifier: Apache-2.0
"""Tests exit codes, messages and help."""

import os
import re

import fixtures
from fixtures import Case, run

VERBS = ["train", "render", "eval", "info", "report", "split"]
OPTIONAL_VERBS = ["import", "synth", "view"]  # some builds lack these verbs


class Usage(Case):
    def refused(self, arguments, *words):
        return self.fails(arguments, *words, code=2)

    def test_no_verb(self):
        self.refused([], "--help")

    def test_unknown_verb_suggests(self):
        self.refused(["trian"], "trian", "'train'")
        self.refused(["qqqqqqq"], "qqqqqqq", "--help")

    def test_benchmarks_are_a_separate_program(self):
        for arguments in [["bench"], ["bench", "stages", "x"], ["bench", "--help"]]:
            self.refused(arguments, "'bench'", "pags-bench")
        self.assertNotIn("bench", self.succeeds("--help").stdout)

    def test_missing_positional_and_output(self):
        self.refused(["train"], "pags train:", "DATASET is missing")
        self.refused(["train", "x"], "-o SCENE is missing")
        self.refused(["render", "x"], "-o FOLDER is missing")

    def test_too_many_positionals(self):
        self.refused(["info", "a", "b"], "unexpected 'b'")

    def test_unknown_option_suggests(self):
        self.refused(["train", "x", "-o", "y", "--iteratons", "3"], "--iteratons", "did you mean '--iterations'")
        self.refused(["info", "x", "--zzzzzz"], "--zzzzzz")
        self.refused(["info", "x", "-Z"], "-Z")

    def test_bad_values(self):
        train = ["train", "x", "-o", "y"]
        expected = "pags train: --iterations: expected a whole number from 1 to 10000000, got 'x'"
        self.assertEqual(self.refused([*train, "--iterations", "x"]), expected)
        for value in ["0", "-5", "1.5", "", "99999999999999999999", "5 ", " 5", "5x"]:
            self.refused([*train, "--iterations", value], "--iterations", "from 1 to 10000000")
        for value in ["nan", "inf", "0.5", "1e999", "2,5"]:
            self.refused([*train, "--downscale", value], "--downscale", "from 1 to 64")
        for value in ["2Q", "-1G", "G", "1e30G"]:
            self.refused([*train, "--image-cache", value], "--image-cache", "512M")
        for value in ["2x", "h", "1h-3m"]:
            self.refused([*train, "--time-limit", value], "--time-limit", "2h")
        for value in ["1,2", "1,2,3,4", "red", "0,0,2"]:
            self.refused([*train, "--background", value], "--background", "r,g,b")
        self.refused([*train, "--strategy", "mc"], "default|mcmc", "'mc'")
        self.refused([*train, "--strategy", ""], "default|mcmc")
        self.refused([*train, "--iterations"], "got nothing")
        self.refused([*train, "--resume=1"], "takes no value")
        self.refused([*train, "--set", "cluster_size=17"], "cluster")

    def test_conflicts(self):
        self.refused(["train", "x", "-o", "y", "--resume", "--overwrite"], "exclude each other")
        self.refused(["train", "x", "-o", "y", "--reconstruction", "--split-every", "4"], "exclude each other")
        self.refused(["render", "x", "-o", "y", "--split", "test", "--path", "ego"], "exclude each other")
        self.refused(["render", "x", "-o", "y", "--dataset", "d"], "--split")
        self.refused(["render", "x", "-o", "y", "--channel", "color,hue"], "'hue'")
        self.refused(["render", "x", "-o", "y", "--bits", "12"], "'12'")

    def test_forms_of_options(self):
        missing = self.path("missing")
        for form in [["--downscale", "2"], ["--downscale=2"], ["-j1"], ["-j", "1"], ["--threads=1"], ["-j=1"]]:
            self.fails(["info", *form, missing], "missing")
        self.fails(["info", "--", missing], "missing")
        self.fails(["info", "--", "--help"], "--help: ")

    def test_help(self):
        top = self.succeeds("--help")
        for verb in VERBS:
            self.assertIn(f"  {verb}", top.stdout)
            shown = self.succeeds(verb, "--help").stdout
            self.assertEqual(shown, self.succeeds(verb, "x", "--bogus", "-h").stdout)
            for line in shown.splitlines():
                self.assertLessEqual(len(line), 100)
                self.assertEqual(line, line.rstrip())
            for general in ["--threads N", "--json FILE|-", "--quiet", "--help", "Exit codes: 0"]:
                self.assertIn(general, shown)

    def test_help_mentions_every_option(self):
        # Every option that --help lists must parse. One option of each kind must show its unit and default.
        for verb in VERBS:
            shown = run(verb, "--help").stdout
            names = re.findall(r"^  (?:-., |    )(--[a-z0-9-]+)( \S+)?", shown, re.M)
            self.assertGreater(len(names), 5)
            for name, value in names:
                if value and not value.startswith(" ["):  # options with a value in brackets may lack the value
                    self.fails([verb, "x", name], f"{name}: expected", "got nothing", code=2)
        shown = " ".join(run("train", "--help").stdout.split())
        self.assertIn("[photographs; default 30000]", shown)
        self.assertIn("[sRGB; default 0,0,0]", shown)
        self.assertIn("[default 0.4]", shown)
        self.assertIn("[default auto: 3; driving sets 1]", shown)
        self.assertNotIn("default -1", shown)

    def test_help_of_train_is_short(self):
        self.assertLessEqual(len(run("train", "--help").stdout.splitlines()), 110)

    def test_settings(self):
        train = ["train", "x", "-o", "y", "--check-options"]
        for good in [
            "densify_from=0",
            "densify_until=auto",
            "densify_until=-1",
            "strategy=mcmc",
            "background_b=0.5",
            "seed=18446744073709551615",
        ]:
            self.succeeds(*train, "--set", good)
        self.refused([*train, "--set", "densify_fro=5"], "densify_fro=5", "did you mean 'densify_from'")
        self.refused([*train, "--set", "qqqqqqqq=5"], "unknown training field 'qqqqqqqq'", "--fields")
        for former in ["absgrad=0", "sky_rate=1e-2", "extent_most=20"]:
            self.succeeds(*train, "--set", former)
        self.refused([*train, "--set", "absgrad=1"], "absgrad: always 0 since PAGS 0.2, got '1'")
        self.refused([*train, "--set", "densify_from"], "expected densify_from=VALUE")
        self.refused([*train, "--set", "densify_from=x"], "densify_from: expected a whole number, got 'x'")
        self.refused([*train, "--set", "densify_from=auto"], "densify_from: expected a whole number, got 'auto'")
        self.refused([*train, "--set", "densify_from=-1"], "densify_from: -1 lies outside of 0..1000000000")
        self.refused(
            [*train, "--set", "critical_weight=0.5"], "critical_weight: 0.5 lies outside of 1..100 and isn't auto"
        )
        self.refused([*train, "--set", "strategy=mc"], "strategy: expected one of default|mcmc, got 'mc'")
        self.refused(
            [*train, "--set", "alpha=0.1", "--set", "alpha=2", "--set", "beta1=0"], "alpha: 2"
        )  # the last --set of a field counts
        self.succeeds(*train, "--set", "alpha=2", "--set", "alpha=1")
        self.succeeds(*train, "--set", "alpha=1", "--alpha", "0.5")

    def test_fields(self):
        """--fields lists every field once with unit, range and default. A default that is decided later isn't shown as
        -1."""
        shown = self.succeeds("train", "--fields").stdout
        self.assertLessEqual(max(map(len, shown.splitlines())), 120)
        fields = re.findall(r"^  ([a-z]\w*) ", shown, re.M)
        self.assertGreater(len(fields), 80)
        self.assertEqual(len(fields), len(set(fields)))
        words = re.sub(r"\s+", " ", shown)
        self.assertEqual(len(re.findall(r"\[[^]]+; default [^]]+\]", words)), len(fields))
        self.assertIn("presets plain and paper 0.2]", words)  # the longest default isn't cut off
        self.assertNotIn("default -1", words)
        for row in [
            "[steps of 30 000; 0 to 1e9; default 500]",
            "[px^2; 0 to 100; default 0.3]",
            "[0 or 1; default 1]",
            "[times the position rate; 0 to 1e9; default 500000]",
            "[default|mcmc; default default]",
            "[0 or 1; default auto: 1; preset plain 0, paper 0]",
            "[1; 0 to 2^64 - 1; default 0]",
        ]:
            self.assertIn(row, words)
        for field in fields:
            self.refused(["train", "x", "-o", "y", "--check-options", "--set", f"{field}=?"], field)

    def test_former_options_name_their_field(self):
        """A former option that is now a field is refused with a message that shows the form --set FIELD=VALUE."""
        for flag, form in [
            (["--densify-from", "500"], "--set densify_from=N"),
            (["--no-fourier"], "--set fourier=0"),
            (["--rolling-shutter"], "--set rolling_shutter=1"),
            (["--near=1"], "--set near_plane=N"),
            (["--position-rate", "1"], "--set position_rate_begin=N"),
            (["--hybrid", "sum"], "--set score=auto|default|paper"),
        ]:
            said = self.refused(["train", "x", "-o", "y", *flag])
            self.assertEqual(said, f"pags train: {flag[0].split('=')[0]} is now {form}")
        self.refused(["train", "x", "-o", "y", "--no-alpha"], "unknown option '--no-alpha'")

    def test_manual_names_every_option(self):
        manual = fixtures.read(os.path.join(os.path.dirname(__file__), "../../docs/command-line.md")).decode()
        for verb in [*VERBS, "merge", "import", "synth"]:
            shown = run(verb, "--help").stdout  # the help is empty if this build lacks the verb
            chapter = manual.split(f"\n## {verb}\n")[-1].split("\n## ")[0] + manual.split("\n## train\n")[0]
            for name in re.findall(r"^  (?:-., |    )(--[a-z0-9-]+)", shown, re.M):
                self.assertTrue(name in chapter or name == "--help", f"{verb} {name} is not in docs/command-line.md")

    def test_verbs_that_some_builds_lack(self):
        top = self.succeeds("--help").stdout
        for verb in OPTIONAL_VERBS:
            row = next(line for line in top.splitlines() if line.startswith(f"  {verb} "))
            if "lacks" in row:
                self.fails([verb], verb, "not in this build")
            else:
                self.assertIn(f"usage: pags {verb}", self.succeeds(verb, "--help").stdout)
                self.refused([verb], f"pags {verb}:")

    def test_export_without_proxies(self):
        """A build without proxies states this in its help, where the Blender add-on reads it, and when proxies are requested."""
        row = next(line for line in self.succeeds("--help").stdout.splitlines() if line.startswith("  export "))
        splats = self.write("some.ply", fixtures.ply_bytes(fixtures.some_splats()))
        if "this build lacks proxies" in row:
            self.fails(["export", splats, self.path("x.glb")], "x.glb", "this build writes")
        else:
            self.assertNotIn("lacks", row)
            self.succeeds("export", splats, self.path("x.glb"), "--splats")

    def test_version(self):
        """The version is the one in base.h. Parts that the build lacks are listed under 'without', and their verbs are
        refused."""
        first, *rest = self.succeeds("--version").stdout.splitlines()
        facts = dict(line.split(":", 1) for line in rest)
        header = fixtures.read(os.path.join(os.path.dirname(__file__), "../../engine/include/pags/base.h")).decode()
        version = ".".join(
            re.search(rf"#define PAGS_VERSION_{part} (\d+)\n", header)[1] for part in ["MAJOR", "MINOR", "PATCH"]
        )
        self.assertEqual(first, f"pags {version}")
        self.assertRegex(facts["commit"], r"^   ([0-9a-f]{12}\+?|unknown|[0-9a-f]{7,40})$")
        self.assertRegex(facts["compiler"], r"^ \w+ [\d.]+, \w*, \w+ \w+$")
        self.assertRegex(facts["kernels"], r"\b(scalar|avx2|avx512|neon) is used$")
        for verb in ["view", "synth", "import"]:
            lacking = f"'{verb}' is not in this build" in run(verb, "--help").stderr
            self.assertEqual(verb in facts["without"].split(), lacking, verb)
            self.assertEqual(verb in facts["with"].split(), not lacking, verb)


if __name__ == "__main__":
    fixtures.main()
