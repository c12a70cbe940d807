# SPDX-License-Identifier: Apache-2.0
"""Tests man pages and completions: bash, zsh and fish offer the options that --help lists."""

import glob
import os
import re
import shutil
import subprocess
import unittest

import fixtures
from fixtures import Case, run


def share(name):
    """Returns the path of a file that the build made in the program's folder."""
    return os.path.join(os.path.dirname(os.path.abspath(fixtures.PAGS)), "share", name)


def listed(verb):
    """Returns the options in a verb's help. Doesn't use the script that makes the completions."""
    text = run(verb, "--help").stdout
    starts = re.findall(r"^ {2,6}(-.*)$", text, re.M)
    return {name for start in starts for name in re.findall(r"(?:^|, )(--?[\w-]+)", start.split("   ")[0])}


def bash(*words):
    """Returns bash's completions of these words. The last word is being typed."""
    file = share("bash-completion/completions/pags")
    script = f'. "{file}"; compopt() {{ :; }}; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _pags; printf "%s\\n" "${{COMPREPLY[@]}}"'
    done = subprocess.run(["bash", "-c", script, "bash", "pags", *words], capture_output=True, text=True)
    assert not done.stderr, done.stderr
    return done.stdout.split()


def zsh(*words):
    """Returns the arguments that zsh's completion passes to _arguments and _describe."""
    file = share("zsh/site-functions/_pags")
    script = f'_arguments() {{ print -rl -- "$@" }}; _describe() {{ print -rl -- $verbs }}; compdef() {{ : }}; . {file}; words=("$@"); CURRENT=$#; _pags'
    done = subprocess.run(["zsh", "-f", "-c", script, "zsh", "pags", *words], capture_output=True, text=True)
    assert not done.stderr, done.stderr
    return done.stdout.split("\n")


def fish(line):
    file = share("fish/vendor_completions.d/pags.fish")
    done = subprocess.run(
        ["fish", "--no-config", "-c", f"source {file}; complete -C '{line}'"], capture_output=True, text=True
    )
    return [row.split("\t")[0] for row in done.stdout.splitlines()]


class Completion(Case):
    def setUp(self):
        super().setUp()
        rows = re.findall(r"^  (\w+) +", self.succeeds("--help").stdout, re.M)
        self.verbs = [verb for verb in rows if run(verb, "--help").returncode == 0]
        self.assertIn("train", self.verbs)
        self.assertIn("--iterations", listed("train"))

    def test_bash_offers_what_help_lists(self):
        self.assertEqual(set(bash("")), {*self.verbs, "--help", "--version"})
        for verb in self.verbs:
            self.assertEqual(set(bash(verb, "-")), listed(verb), verb)
        self.assertEqual(bash("train", "--strategy", ""), ["default", "mcmc"])
        self.assertEqual(bash("train", "--strategy", "=", "mc"), ["mcmc"])
        self.assertEqual(bash("export", "--sh-degree", "="), ["0", "1", "2", "3"])
        self.assertEqual(bash("train", "--iterations", ""), [])

    def test_bash_offers_files_and_fields(self):
        folder = self.path("some")
        os.mkdir(folder)
        self.assertEqual(bash("train", self.path("so")), [folder])
        self.assertEqual(bash("info", "x", "--json", self.path("so")), [folder])
        fields = re.findall(r"^  (\w+)", self.succeeds("train", "--fields").stdout, re.M)
        self.assertTrue(set(bash("train", "--set", "")) <= {name + "=" for name in fields})
        self.assertIn("alpha_min=", bash("train", "--set", "alpha_m"))

    @unittest.skipUnless(shutil.which("zsh"), "no zsh")
    def test_zsh_offers_what_help_lists(self):
        self.assertEqual([row.split(":")[0] for row in zsh("") if row], self.verbs)
        for verb in self.verbs:
            found = {
                re.sub(r"[=+]$", "", match[1])
                for row in zsh(verb, "-")
                for match in [re.match(r"(?:\(.*?\))?\*?(-\S+?)\[", row)]
                if match
            }
            self.assertEqual(found, listed(verb), verb)
        self.assertTrue(
            any(
                row.startswith("--strategy=[") and row.endswith(":default|mcmc:(default mcmc)")
                for row in zsh("train", "-")
            )
        )

    @unittest.skipUnless(shutil.which("fish"), "no fish")
    def test_fish_offers_what_help_lists(self):
        self.assertTrue(set(self.verbs) <= set(fish("pags ")))
        for verb in self.verbs:
            self.assertEqual(
                set(fish(f"pags {verb} --")), {name for name in listed(verb) if name.startswith("--")}, verb
            )
        self.assertEqual(set(fish("pags train --strategy ")), {"default", "mcmc"})

    def test_man_pages(self):
        pages = sorted(os.path.basename(path) for path in glob.glob(share("man/man1/*")))
        self.assertEqual(pages, sorted(["pags.1", *(f"pags-{verb}.1" for verb in self.verbs)]))
        for verb in self.verbs:
            with open(share(f"man/man1/pags-{verb}.1"), encoding="utf-8") as file:
                text = file.read()
            self.assertEqual(
                {name.replace("\\-", "-") for name in re.findall(r"\\fB(\S+?)\\fR", text)}, listed(verb), verb
            )
            for section in ["NAME", "SYNOPSIS", "DESCRIPTION", "OPTIONS", '"EXIT STATUS"', '"SEE ALSO"']:
                self.assertIn(f"\n.SH {section}\n", text)
        if shutil.which("groff"):
            for path in glob.glob(share("man/man1/*")):
                done = subprocess.run(["groff", "-ww", "-man", "-z", "-Tutf8", path], capture_output=True, text=True)
                self.assertEqual(done.stderr, "", path)


if __name__ == "__main__":
    fixtures.main()
