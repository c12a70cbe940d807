#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""manual_pages.py PAGS FOLDER: writes man pages and shell completions from the help of the program PAGS, below FOLDER:
man/man1/pags.1 and a page per verb; completions of verbs, options, choices and fields for bash, zsh and fish."""

import os
import re
import sys

import help_text

# ---- man pages ----


def roff(text):
    text = text.replace("\\", "\\e").replace("-", "\\-")
    return "\\&" + text if text[:1] in (".", "'") else text


def entry(left, text):
    names, value = help_text.names(left)
    shown = ", ".join(rf"\fB{roff(name)}\fR" for name in names)
    if value:
        shown += (" " if names else "") + rf"\fI{roff(value)}\fR"
    return f".TP\n{shown}\n{roff(text)}\n"


def page(name, summary, version, usage, about, sections, after):
    text = f'.TH {roff(name).upper()} 1 "" "pags {version}" "PAGS"\n.ad l\n.SH NAME\n{roff(name)} \\- {roff(summary)}\n.SH SYNOPSIS\n{roff(usage)}\n'
    text += ".SH DESCRIPTION\n" + ".PP\n".join(roff(paragraph) + "\n" for paragraph in about)
    for heading, entries in sections:
        text += (f'.SS "{roff(heading)}"\n' if heading else ".SH OPTIONS\n") + "".join(
            entry(left, words) for left, words in entries
        )
    return text + '.SH "EXIT STATUS"\n' + roff(after) + "\n"


def exit_codes(paragraphs):
    return next(text for text in paragraphs if text.startswith("Exit codes: "))[len("Exit codes: ") :]


def man_pages(program, verbs):
    version = help_text.printed(program, "--version").split()[1]
    usage, paragraphs, _ = help_text.read(help_text.printed(program, "--help"))
    codes = re.search(r"Exit codes: (.*)", " ".join(paragraphs))[1]
    see = "\n.BR pags\\-" + " (1),\n.BR pags\\-".join(verbs) + " (1)\n"
    pages = {
        "pags.1": page(
            "pags",
            "Gaussian splatting of driving scenes on processors",
            version,
            usage,
            [
                "Turns recordings of a driving car and photographs of static scenes into 3D Gaussians, draws and exports them."
            ],
            [("", [(name, text) for name, text in verbs.items()] + [("--version", "print version and build")])],
            codes,
        )
        + '.SH "SEE ALSO"'
        + see
    }
    for verb, summary in verbs.items():
        usage, paragraphs, sections = help_text.read(help_text.printed(program, verb, "--help"))
        about = [text for text in paragraphs if not text.startswith("Exit codes: ")]
        first, *others = sections
        about, sections = [*about, *([first[0]] if first[0] else [])], [("", first[1]), *others]
        text = page(f"pags-{verb}", summary, version, usage, about, sections, exit_codes(paragraphs))
        pages[f"pags-{verb}.1"] = text + '.SH "SEE ALSO"\n.BR pags (1)\n'
    return pages


# ---- completions ----


class Option:
    """One option of a verb: its names, the placeholder of its value ("" of a flag), what it does, and what may be completed."""

    def __init__(self, left, text, fields):
        self.names, self.value = help_text.names(left)
        self.text = text
        words = self.value.split("|")
        self.choices = (
            [word for word in words if re.fullmatch(r"[a-z0-9-][a-z0-9-]+|-|\d+", word)] if len(words) > 1 else []
        )
        if re.fullmatch(r"\d\.\.\d", self.value):
            self.choices = [str(number) for number in range(int(self.value[0]), int(self.value[-1]) + 1)]
        if self.value == "NAME=VALUE":
            self.choices = [name + "=" for name in fields]
        self.files = any(word in ("FILE", "FOLDER", "DATASET", "SCENE") for word in words)


def options_of(program, verbs):
    fields = [
        left.split()[0]
        for _, entries in help_text.read(help_text.printed(program, "train", "--fields"))[2]
        for left, _ in entries
    ]
    found = {}
    for verb in verbs:
        sections = help_text.read(help_text.printed(program, verb, "--help"))[2]
        found[verb] = [
            Option(left, text, fields) for _, entries in sections for left, text in entries if left.startswith("-")
        ]
    return found


def quoted(text):
    return "'" + text.replace("'", "'\\''") + "'"


def bash(verbs, options):
    cases = ""
    for verb, rows in options.items():
        for row in rows:
            if row.value:
                words = f'compgen -W {quoted(" ".join(row.choices))} -- "$cur"' if row.choices else ":"
                files = '; compgen -f -- "$cur"' if row.files else ""
                pattern = " | ".join(f'"{verb} {name}"' for name in row.names)
                space = "; compopt -o nospace" if row.value == "NAME=VALUE" else ""
                cases += f"    {pattern}) mapfile -t COMPREPLY < <({words}{files}){space}; return ;;\n"
    lists = "".join(
        f'      {verb}) mapfile -t COMPREPLY < <(compgen -W {quoted(" ".join(name for row in rows for name in row.names))} -- "$cur") ;;\n'
        for verb, rows in options.items()
    )
    return f"""# Completion of pags for bash; written by scripts/manual_pages.py.
_pags() {{
  local cur=${{COMP_WORDS[COMP_CWORD]}} prev=${{COMP_WORDS[COMP_CWORD - 1]}} verb=${{COMP_WORDS[1]}}
  COMPREPLY=()
  if [ "$COMP_CWORD" -eq 1 ]; then
    mapfile -t COMPREPLY < <(compgen -W '{" ".join(verbs)} --help --version' -- "$cur")
    return
  fi
  # --name=value is three words to bash
  if [ "$cur" = "=" ]; then cur=""; elif [ "$prev" = "=" ]; then prev=${{COMP_WORDS[COMP_CWORD - 2]}}; fi
  case "$verb $prev" in
{cases}  esac
  case $cur in
    -*) case $verb in
{lists}      esac ;;
    *) mapfile -t COMPREPLY < <(compgen -f -- "$cur") ;;
  esac
}}
complete -o filenames -F _pags pags
"""


def zsh(verbs, options):
    def spec(row):
        text = re.sub(r"([\[\]:\\])", r"\\\1", row.text)
        action = f"({' '.join(row.choices)})" if row.choices else " "
        action = "_files" if row.files and not row.choices else action
        value = ":" + re.sub(r"([\[\]:\\])", r"\\\1", row.value) + ":" + action if row.value else ""
        exclude = f"({' '.join(row.names)})" if len(row.names) > 1 else ""
        repeated = "*" if "again" in row.text or "repeated" in row.text else ""
        rows = []
        for name in row.names:
            mark = ("=" if name.startswith("--") else "+") if row.value else ""
            rows.append("      " + quoted(f"{'' if repeated else exclude}{repeated}{name}{mark}[{text}]{value}"))
        return " \\\n".join(rows)

    cases = "".join(
        f"    {verb})\n    _arguments -S \\\n"
        + " \\\n".join(spec(row) for row in rows)
        + " \\\n      '*:file:_files' ;;\n"
        for verb, rows in options.items()
    )
    summaries = "\n".join("    " + quoted(f"{verb}:{text.replace(':', chr(92) + ':')}") for verb, text in verbs.items())
    return f"""#compdef pags
# Completion of pags for zsh; written by scripts/manual_pages.py.
_pags() {{
  local -a verbs
  verbs=(
{summaries}
  )
  if (( CURRENT == 2 )); then
    _describe verb verbs
    return
  fi
  local verb=$words[2]
  shift words
  (( CURRENT-- ))
  case $verb in
{cases}  esac
}}
if [ "$funcstack[1]" = _pags ]; then
  _pags "$@"
else
  compdef _pags pags
fi
"""


def fish(verbs, options):
    def text_of(text):
        return "'" + text.replace("\\", "\\\\").replace("'", "\\'") + "'"

    lines = [
        "# Completion of pags for fish; written by scripts/manual_pages.py.",
        "complete -c pags -n __fish_use_subcommand -f",
        "complete -c pags -n __fish_use_subcommand -l help -d 'list the verbs'",
        "complete -c pags -n __fish_use_subcommand -l version -d 'print version and build'",
    ]
    lines += [f"complete -c pags -n __fish_use_subcommand -a {verb} -d {text_of(text)}" for verb, text in verbs.items()]
    for verb, rows in options.items():
        for row in rows:
            names = "".join(f" -l {name[2:]}" if name.startswith("--") else f" -s {name[1:]}" for name in row.names)
            value = ("" if not row.value else " -r" if row.files else " -x") + (
                f" -a {text_of(' '.join(row.choices))}" if row.choices else ""
            )
            lines.append(
                f"complete -c pags -n '__fish_seen_subcommand_from {verb}'{names}{value} -d {text_of(row.text)}"
            )
    return "\n".join(lines) + "\n"


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    program, folder = sys.argv[1:]
    verbs = help_text.verbs(program)
    options = options_of(program, verbs)
    files = {f"man/man1/{name}": text for name, text in man_pages(program, verbs).items()}
    files["bash-completion/completions/pags"] = bash(verbs, options)
    files["zsh/site-functions/_pags"] = zsh(verbs, options)
    files["fish/vendor_completions.d/pags.fish"] = fish(verbs, options)
    for name, text in files.items():
        path = os.path.join(folder, name)
        os.makedirs(os.path.dirname(path), exist_ok=True)
        with open(path, "w", encoding="utf-8", newline="\n") as file:
            file.write(text)


if __name__ == "__main__":
    main()
