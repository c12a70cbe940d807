#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Measures structure, size and language of the code and the manual. Compares a commit with the working tree
(--reference COMMIT), or fails if a limit is exceeded (--check). Both states are formatted by the same rules before lines
are counted.

    tests/figures.py --reference COMMIT     a table in Markdown, before and after
    tests/figures.py --check                FILE: fault, for the test suite
    tests/figures.py --list once            functions called once, with their length, by file
    tests/figures.py --list phrases         unidiomatic phrases, with file and line
    tests/figures.py --list headers         internal headers below 25 lines

Definitions:
- Function: a definition in C or C++ (at file scope, also below `extern "C"` and in namespaces) or in Python (methods and nested ones too) in
  engine, simd, threads, exporters, cli, blender_addon and benchmarks. Tests, tools and scripts neither define nor call here.
- Called once: a function with one call in all of these folders, recursive calls not counted, and no other mention. Functions whose
  address is passed or stored (a loop's body for parallel_for, a table's entry, a callback) don't count, nor functions that Blender or
  Python calls. Bodies of macros are code. A name is searched in the caller's file first, then among functions that aren't static.
- Length: lines from the signature to the closing brace after formatting, without comments and empty lines.
- Circle: a group of files that reach each other by calls (a strongly connected component). A header and its source are one file.
- Lines: neither empty nor comment (in Python, docstrings are comments), after formatting.
- Words: as wc -w; text of the manual between `<!-- generated` and `<!-- end -->` is not counted (tests/docs.py checks it).
- Phrases: matches of PHRASES, per 1,000 words, in comments (C, C++, JavaScript, Python with docstrings; tests too), in the manual (docs/*.md,
  README, CONTRIBUTING), and in string literals of C and of the add-on: help, field texts, messages.
- Internal headers: those of the program's folders outside of include/pags.
- Makefile targets: those with a line in `make help`, without the names check-NAME.
"""

import argparse
import ast
import concurrent.futures
import io
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import tokenize
from collections import Counter, defaultdict
from pathlib import Path

FORMATTER = "19.1.7"
LONGEST_FUNCTION = 120  # lines
LONGEST_PAGE = 1500  # words
SMALL_HEADER = 25  # lines
# Limits of --check, which may only be lowered.
MOST_PHRASES = {"comments": 0.2, "manual": 0.1}  # per 1,000 words
MOST_PHRASES_IN_STRINGS = 0
MOST_SMALL_HEADERS = 15
MOST_TARGETS = 25
PROGRAM_FOLDERS = ["engine", "simd", "threads", "exporters", "cli", "blender_addon", "benchmarks"]
LINE_FOLDERS = PROGRAM_FOLDERS + ["tools", "scripts"]
FORMATTED_FOLDERS = LINE_FOLDERS + ["tests", "examples"]
SKIPPED = re.compile(r"^(build.*|\.git|\.venv|node_modules|__pycache__|external|third_party|musl)$")
C_KINDS = {".c", ".h", ".inl", ".cc", ".hh", ".cpp"}
# English that a native engineer would not write (CONTRIBUTING.md, rule 1).
PHRASES = re.compile(
    r"\b(?:so (?:often|many|far|long|much)|beside|stands? for|as (?:it|they) stands?|says? (?:what|how|which|where|who)|by chance"
    r"|(?:is|are) (?:told|asked)|goes on|is none|are none|apart|what (?:is|are|was) (?:kept|left|seen|drawn|shown|meant)"
    r"|is no field|is no Debian)\b",
    re.I,
)
FIRST_WORDS = re.compile(r"(?:(?<=[.!?:] )|^)(?:Of|What|Who) ", re.M)
KEYWORDS = set(
    "if for while switch return sizeof do else case goto default typeof alignof _Alignof _Static_assert static_assert defined "
    "catch throw new delete alignas _Alignas decltype static_cast reinterpret_cast const_cast noexcept operator".split()
)


# ---- The files of a commit or of the working tree ----
def walk(root, folders):
    for folder in folders:
        for base, names, files in os.walk(root / folder):
            names[:] = sorted(name for name in names if not SKIPPED.match(name))
            for name in sorted(files):
                yield Path(base, name).relative_to(root)


def find_formatter(given, root):
    for program in [given] if given else [str(root / "scripts/.venv/bin/clang-format"), "clang-format"]:
        if not shutil.which(program):
            continue
        version = subprocess.run([program, "--version"], capture_output=True, text=True).stdout
        if FORMATTER in version:
            return program
        if given:
            sys.exit(f"figures: {given} is{version.split('version')[-1].rstrip()}, not {FORMATTER}")
    sys.exit(f"figures: no clang-format {FORMATTER}; 'make setup' installs it into scripts/.venv")


def root_of_repository():
    here = Path(__file__).resolve().parent.parent
    return here if (here / "CMakeLists.txt").exists() else Path.cwd()


class State:
    """A formatted copy of the sources of one commit or of the working tree."""

    def __init__(self, root, formatter, style, scratch):
        self.root, self.copy = root, scratch
        self.code = [path for path in walk(root, FORMATTED_FOLDERS) if path.suffix in C_KINDS]
        for path in walk(root, FORMATTED_FOLDERS):
            if path.suffix in C_KINDS or path.suffix in (".py", ".sh", ".cmake") or path.name == "CMakeLists.txt":
                (scratch / path).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(root / path, scratch / path)
        shutil.copyfile(style, scratch / ".clang-format")
        pieces = [self.code[i::4] for i in range(4)]
        with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
            for done in pool.map(
                lambda piece: (
                    subprocess.run([formatter, "-i", *map(str, piece)], cwd=scratch, capture_output=True, text=True)
                    if piece
                    else None
                ),
                pieces,
            ):
                if done is not None and done.returncode != 0:
                    sys.exit(f"figures: {formatter}: {done.stderr.strip()[:500]}")
        self.unformatted = [path for path in self.code if (root / path).read_bytes() != (scratch / path).read_bytes()]

    def text(self, path):
        return (self.copy / path).read_text(encoding="utf-8", errors="replace")


# ---- C and C++ ----
TOKEN = re.compile(r"[A-Za-z_]\w*|->|::|&&|\|\||==|!=|<=|>=|\.?\d[\w.]*|\S")


def without_comments(text):
    """Returns the text with blanks in place of comments and literals, so that line numbers stay."""

    def blank(match):
        word = match.group(0)
        if word[0] in "\"'":
            return word[0] + word[0]
        return re.sub(r"[^\n]", " ", word)

    return re.sub(r'"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])*\'|//[^\n]*|/\*.*?\*/', blank, text, flags=re.S)


class Function:
    def __init__(self, name, path, line, static, outside, length, tokens):
        self.name, self.path, self.line, self.static, self.outside, self.length, self.tokens = (
            name,
            path,
            line,
            static,
            outside,
            length,
            tokens,
        )
        self.calls, self.mentions, self.callers = 0, 0, []


class CFile:
    """Returns the functions of a C file, and the names that initialisers and macros mention."""

    def __init__(self, path, text):
        self.path, self.functions, self.rest = path, [], []
        bare = without_comments(text)
        filled = [bool(line.strip()) for line in bare.split("\n")]

        def take_macro(match):
            found = re.match(r"\s*#\s*define\s+(\w+)(?:\([^)]*\))?(.*)", match.group(0).replace("\\\n", " "), re.S)
            if found:
                self.rest.append([(word, 0) for word in TOKEN.findall(found.group(2))])
            return re.sub(r"[^\n]", " ", match.group(0))

        bare = re.sub(r"^[ \t]*#(?:[^\n\\]|\\\n|\\.)*", take_macro, bare, flags=re.M)
        tokens = []
        for number, content in enumerate(bare.split("\n"), 1):
            tokens += [(word, number) for word in TOKEN.findall(content)]
        self.scan(tokens, filled)

    def scan(self, tokens, filled):
        i, start = 0, 0
        while i < len(tokens):
            word = tokens[i][0]
            if word == ";":
                statement = tokens[start:i]
                if any(token[0] == "=" for token in statement):
                    self.rest.append(statement[next(k for k, t in enumerate(statement) if t[0] == "=") :])
                i += 1
                start = i
            elif word == "{":
                head = [token[0] for token in tokens[start:i]]
                if head[:1] == ["extern"] and len(head) <= 3 or "namespace" in head:
                    i += 1
                    start = i
                    continue
                end = self.matching(tokens, i)
                name = self.function_name(head)
                if name:
                    lines = sum(filled[tokens[start][1] - 1 : tokens[end][1]])
                    self.functions.append(
                        Function(
                            name, self.path, tokens[start][1], "static" in head, False, lines, tokens[start : end + 1]
                        )
                    )
                    i = end + 1
                    start = i
                else:
                    i = end + 1  # skips a struct, enum or initialiser up to its semicolon
            elif word == "}":
                i += 1
                start = i
            else:
                i += 1

    @staticmethod
    def matching(tokens, i):
        depth = 0
        for k in range(i, len(tokens)):
            depth += (tokens[k][0] == "{") - (tokens[k][0] == "}")
            if depth == 0:
                return k
        return len(tokens) - 1

    @staticmethod
    def function_name(head):
        """Returns the function's name, the identifier before its parameters, or None if `head` isn't a function's head."""
        if "=" in head or "(" not in head or head[0] in ("typedef", "enum"):
            return None
        while (
            len(head) > 1
            and head[1] == "("
            and re.fullmatch(r"[A-Z][A-Z0-9_]+", head[0])
            and CFile.after_parenthesis(head, 1) < len(head)
        ):
            head = head[CFile.after_parenthesis(head, 1) :]  # VARIANT(...) without a semicolon, before the function
        if "(" not in head:
            return None
        depth, k = 0, 0
        while k < len(head):
            if head[k] == "(" and depth == 0 and k > 0 and re.match(r"[A-Za-z_]", head[k - 1]):
                if head[k - 1] in ("__attribute__", "PAGS_PRINTF", "alignas", "_Alignas"):
                    while depth or head[k] == "(":
                        depth += (head[k] == "(") - (head[k] == ")")
                        k += 1
                        if depth == 0:
                            break
                    continue
                after = CFile.after_parenthesis(head, k)
                if after < len(head) and head[after] == "(":  # NAME(blend)(...): a macro makes the name
                    return head[k + 1]
                return head[k - 1] if k >= 2 or len(head) > 2 else None
            k += 1
        return None

    @staticmethod
    def after_parenthesis(head, k):
        depth = 0
        for at in range(k, len(head)):
            depth += (head[at] == "(") - (head[at] == ")")
            if depth == 0:
                return at + 1
        return len(head)


def uses(tokens):
    """Yields (name, is a call) for each identifier that may name a function, without local names."""
    words = [token[0] for token in tokens]
    local = set()
    for k in range(1, len(words) - 1):
        if re.match(r"[A-Za-z_]\w*$", words[k]) and words[k + 1] in ("=", ";", ",", ")", "[", ":", "{"):
            before = words[k - 1]
            if before == "*" or (re.match(r"[A-Za-z_]\w*$", before) and before not in KEYWORDS):
                local.add(words[k])
    for k, word in enumerate(words):
        if not re.match(r"[A-Za-z_]\w*$", word) or word in KEYWORDS or word in local:
            continue
        if k and words[k - 1] in (".", "->"):
            continue
        call = k + 1 < len(words) and words[k + 1] == "("
        if words[k + 1 : k + 2] == ["<"]:  # name<type>(...)
            close = next((at for at in range(k + 2, min(k + 8, len(words))) if words[at] == ">"), None)
            call = close is not None and words[close + 1 : close + 2] == ["("]
        if call and k and re.match(r"[A-Za-z_]\w*$", words[k - 1]) and words[k - 1] not in KEYWORDS:
            if words[k - 1] not in ("else", "do"):
                continue  # a declaration: TYPE name(
        yield word, call


# ---- Python ----
BLENDER_CALLS = {
    "draw",
    "execute",
    "invoke",
    "modal",
    "poll",
    "cancel",
    "check",
    "register",
    "unregister",
    "main",
    "update",
    "render",
    "view_update",
    "view_draw",
    "draw_item",
    "filter_items",
    "draw_header",
    "cancel",
    "description",
    "handle_drop",
    "poll_drop",
}


class PythonFile:
    def __init__(self, path, text):
        self.path, self.functions = path, []
        self.tree = ast.parse(text)
        self.code_lines = python_code_lines(text, self.tree)
        self.imports = {}  # local name -> (module's last part, name in it or None)
        for node in ast.walk(self.tree):
            if isinstance(node, ast.ImportFrom):
                for alias in node.names:
                    self.imports[alias.asname or alias.name] = ((node.module or "").split(".")[-1], alias.name)
            elif isinstance(node, ast.Import):
                for alias in node.names:
                    self.imports[alias.asname or alias.name.split(".")[0]] = (alias.name.split(".")[-1], None)
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
                length = sum(1 for line in range(node.lineno, node.end_lineno + 1) if line in self.code_lines)
                outside = node.name in BLENDER_CALLS or node.name.startswith("__") or bool(node.decorator_list)
                self.functions.append(Function(node.name, path, node.lineno, True, outside, length, node))
        self.classes = {node.name for node in ast.walk(self.tree) if isinstance(node, ast.ClassDef)}
        self.names = {f.name for f in self.functions} | self.classes

    def uses(self):
        """Yields (node of the name, name, is a call, module that it is taken from or '')."""
        called = {id(node.func) for node in ast.walk(self.tree) if isinstance(node, ast.Call)}
        for node in ast.walk(self.tree):
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
                module, name = self.imports.get(node.id, ("", node.id))
                yield node, name or node.id, id(node) in called, module if name else ""
            elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load):
                module = ""
                if isinstance(node.value, ast.Name) and node.value.id in self.imports:
                    module = self.imports[node.value.id][1] or self.imports[node.value.id][0]
                yield node, node.attr, id(node) in called, module


def python_code_lines(text, tree):
    """Returns the numbers of the lines that have code, not only comments or docstrings."""
    lines = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in (
            tokenize.COMMENT,
            tokenize.NL,
            tokenize.NEWLINE,
            tokenize.INDENT,
            tokenize.DEDENT,
            tokenize.ENDMARKER,
        ):
            lines.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(tree):
        if (
            isinstance(node, (ast.Module, ast.FunctionDef, ast.ClassDef, ast.AsyncFunctionDef))
            and ast.get_docstring(node, False) is not None
        ):
            lines.difference_update(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    return lines


# ---- The call graph ----
def node_of(path):
    """Returns the node of a file in the call graph; a header and its source are one node."""
    return str(path.with_suffix("")) if path.suffix in C_KINDS else str(path)


class Program:
    def __init__(self, state):
        files = [path for path in walk(state.copy, PROGRAM_FOLDERS)]
        self.c = [CFile(path, state.text(path)) for path in files if path.suffix in C_KINDS]
        self.python = [PythonFile(path, state.text(path)) for path in files if path.suffix == ".py"]
        self.functions = [f for file in self.c + self.python for f in file.functions]
        self.edges = defaultdict(dict)  # node -> {node: a call, as text}
        self.count_c()
        self.count_python()

    def count_c(self):
        private, shared = defaultdict(list), defaultdict(list)
        for function in (f for file in self.c for f in file.functions):
            if function.static and function.path.suffix in (".c", ".cc", ".cpp"):
                private[function.path, function.name].append(function)
            else:
                shared[function.name].append(function)
        for file in self.c:
            spans = [(f, f.tokens[1:]) for f in file.functions] + [(None, tokens) for tokens in file.rest]
            for owner, tokens in spans:
                for name, call in uses(tokens):
                    if owner and name == owner.name:
                        continue
                    targets = shared.get(name, [])
                    targets = private.get((file.path, name)) or [f for f in targets if f.path == file.path] or targets
                    for target in targets:
                        self.count(target, call, f"{file.path}: {owner.name}" if owner else str(file.path))
                        if (
                            call and len(targets) == 1
                        ):  # a function that several files define, one for each ISA, gives no edge
                            self.edge(file.path, target.path, name)

    def count_python(self):
        by_name = defaultdict(list)
        modules = {file.path.stem: file for file in self.python}
        for function in (f for file in self.python for f in file.functions):
            by_name[function.name].append(function)
        for file in self.python:
            own = {f.name for f in file.functions}
            for node, name, call, module in file.uses():
                if module and module in modules and name in modules[module].names and modules[module] is not file:
                    self.edge(file.path, modules[module].path, name)
                if module:
                    targets = [f for f in by_name.get(name, []) if f.path.stem == module]
                elif name in own:
                    targets = [f for f in by_name[name] if f.path == file.path]
                else:
                    targets = by_name.get(name, []) if isinstance(node, ast.Attribute) else []
                for target in targets:
                    if target.path == file.path and target.tokens.lineno <= node.lineno <= target.tokens.end_lineno:
                        continue
                    self.count(target, call, f"{file.path}:{node.lineno}")

    def count(self, target, call, where):
        if call:
            target.calls += 1
            target.callers.append(where)
        else:
            target.mentions += 1

    def edge(self, source, target, name):
        if node_of(source) != node_of(target):
            self.edges[node_of(source)].setdefault(node_of(target), name)

    def once(self):
        return [f for f in self.functions if f.calls == 1 and f.mentions == 0 and not f.outside]

    def circles(self):
        """Strongly connected components of more than one file (Tarjan 1972), each as a sorted list."""
        index, low, stack, on, found = {}, {}, [], set(), []

        def visit(node):
            index[node] = low[node] = len(index)
            stack.append(node)
            on.add(node)
            for other in sorted(self.edges.get(node, ())):
                if other not in index:
                    visit(other)
                    low[node] = min(low[node], low[other])
                elif other in on:
                    low[node] = min(low[node], index[other])
            if low[node] == index[node]:
                group = []
                while not group or group[-1] != node:
                    group.append(stack.pop())
                    on.discard(group[-1])
                if len(group) > 1:
                    found.append(sorted(group))

        sys.setrecursionlimit(10000)
        for node in sorted(self.edges):
            if node not in index:
                visit(node)
        return sorted(found)

    def describe(self, circle):
        calls = [f"{a} calls {name} of {b}" for a in circle for b, name in sorted(self.edges[a].items()) if b in circle]
        return f"{', '.join(circle)} call each other: {'; '.join(calls[:6])}"


# ---- Lines and words ----
def lines_of(state, path):
    text = state.text(path)
    if path.suffix in C_KINDS:
        return sum(bool(line.strip()) for line in without_comments(text).split("\n"))
    if path.suffix == ".py":
        return len(python_code_lines(text, ast.parse(text)))
    return sum(bool(line.strip()) and not line.lstrip().startswith("#") for line in text.split("\n"))


def line_counts(state):
    counts = Counter()
    for path in walk(state.copy, LINE_FOLDERS):
        if path.suffix == ".py" and path.parts[0] != "benchmarks":
            counts["Python"] += lines_of(state, path)
        else:
            counts[path.parts[0]] += lines_of(state, path)
    return counts


def words_of(text):
    return len(re.sub(r"<!-- generated.*?<!-- end -->", "", text, flags=re.S).split())


def pages(root, folder):
    return {
        str(path.relative_to(root)): words_of(path.read_text(encoding="utf-8"))
        for path in sorted((root / folder).glob("*.md"))
    }


def help_lines(program):
    if not program or not Path(program).exists():
        return None
    return len(subprocess.run([program, "train", "--help"], capture_output=True, text=True).stdout.splitlines())


# ---- Language ----
def comments_of(path, text):
    """Returns the comments of a file, line by line, as (line, text)."""
    if path.suffix == ".py":
        found = []
        for token in tokenize.generate_tokens(io.StringIO(text).readline):
            if token.type == tokenize.COMMENT:
                found.append((token.start[0], token.string.lstrip("# ")))
            elif token.type == tokenize.STRING and token.string.startswith(('"""', 'r"""')):
                found += enumerate(token.string.strip('r"').split("\n"), token.start[0])
        return found
    found = []
    for match in re.finditer(r"/\*.*?\*/|//[^\n]*", text, re.S):
        bare = re.sub(r"^\s*\*+ ?|/\*+|\*/", "", match.group(0), flags=re.M)
        found += enumerate(bare.split("\n"), text.count("\n", 0, match.start()) + 1)
    return found


def strings_of(path, text):
    """Returns the string literals of a file as (line, text); adjacent literals are joined."""
    if path.suffix == ".py":
        return [
            (node.lineno, node.value)
            for node in ast.walk(ast.parse(text))
            if isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and " " in node.value
            and "\n    " not in node.value
        ]
    bare = re.sub(
        r"/\*.*?\*/|(?<![:\"])//[^\n]*", lambda match: re.sub(r"[^\n]", " ", match.group(0)), text, flags=re.S
    )
    literal = r'"(?:\\.|[^"\\\n])*"'
    return [
        (bare.count("\n", 0, match.start()) + 1, re.sub(r'"\s*(?:PRI\w+\s*)?"', "", match.group(0))[1:-1])
        for match in re.finditer(rf"{literal}(?:\s*{literal})*", bare)
    ]


def language(root):
    """Returns {kind: (words, [(path, line, phrase, text)])} for comments, manual and strings."""
    kinds = {kind: [0, []] for kind in ("comments", "manual", "strings")}

    def add(kind, path, parts):
        for line, text in parts:
            kinds[kind][0] += len(text.split())
            kinds[kind][1] += [
                (path, line, match.group(0), text.strip())
                for pattern in (PHRASES, FIRST_WORDS)
                for match in pattern.finditer(text)
            ]

    for path in walk(root, FORMATTED_FOLDERS):
        if path.suffix in C_KINDS | {".py", ".mjs", ".js"}:
            text = (root / path).read_text(encoding="utf-8", errors="replace")
            add("comments", path, comments_of(path, text))
            if path.parts[0] in (
                "engine",
                "exporters",
                "cli",
                "threads",
                "blender_addon",
            ) and path.suffix in C_KINDS | {".py"}:
                add("strings", path, strings_of(path, text))
    for path in [*sorted((root / "docs").glob("*.md")), root / "README.md", root / "CONTRIBUTING.md"]:
        if path.exists():
            add("manual", path.relative_to(root), enumerate(path.read_text(encoding="utf-8").split("\n"), 1))
    return kinds


def per_thousand(kind):
    words, found = kind
    return 1000 * len(found) / max(words, 1)


def small_headers(root):
    """Returns the internal headers, and those below SMALL_HEADER lines."""
    headers = [path for path in walk(root, PROGRAM_FOLDERS) if path.suffix == ".h" and "include/pags" not in str(path)]
    return headers, [path for path in headers if (root / path).read_bytes().count(b"\n") < SMALL_HEADER]


def targets(root):
    """Returns the Makefile's targets with a text for `make help`; all targets in Makefiles without such texts."""
    text = (root / "Makefile").read_text(encoding="utf-8")
    named = re.findall(r"^([a-z%-]+):.*## ", text, re.M)
    return named or [name for line in re.findall(r"^\.PHONY:(.*)$", text, re.M) for name in line.split()]


# ---- Output ----
def figures(state, program_path):
    program = Program(state)
    functions, once, counts = program.functions, program.once(), line_counts(state)
    manual, lab = pages(state.root, "docs"), pages(state.root, "docs/lab")
    largest = max(manual, key=manual.get) if manual else ""
    words, (headers, small) = language(state.root), small_headers(state.root)
    changelog = (state.root / "CHANGELOG.md").read_text(encoding="utf-8")
    lines = sorted(f.length for f in functions)
    plain = sum(n for folder, n in counts.items() if folder not in ("Python", "benchmarks"))
    rows = [
        ("functions", f"{len(functions)}", ""),
        ("called once in the whole program", f"{100 * len(once) / len(functions):.1f} % ({len(once)})", "38 %"),
        ("of these of at most 8 lines", f"{sum(f.length <= 8 for f in once)}", ""),
        (
            "function's length, median, p90, longest",
            f"{lines[len(lines) // 2]}, {lines[len(lines) * 9 // 10]}, {lines[-1]}",
            "<= 120",
        ),
        (f"functions over {LONGEST_FUNCTION} lines", f"{sum(f.length > LONGEST_FUNCTION for f in functions)}", "0"),
        ("circles of files", f"{len(program.circles())}", "0"),
        ("files in these circles", f"{sum(map(len, program.circles()))}", "0"),
        ("files out of format", f"{len(state.unformatted)} of {len(state.code)}", "0"),
        ("product lines: without tests, Python and benchmarks", f"{plain}", "80,000"),
    ]
    rows += [
        (f"lines of {folder}", f"{counts[folder]}", "")
        for folder in LINE_FOLDERS
        if folder != "benchmarks" and counts[folder]
    ]
    rows += [
        ("lines of benchmarks", f"{counts['benchmarks']}", ""),
        ("lines of Python elsewhere", f"{counts['Python']}", ""),
        ("lines of `pags train --help`", str(help_lines(program_path) or "-"), "<= 110"),
        ("phrases per 1,000 words of comments", f"{per_thousand(words['comments']):.2f}", "0.3"),
        ("phrases per 1,000 words of the manual", f"{per_thousand(words['manual']):.2f}", "0.3"),
        ("phrases in help, field texts and messages", f"{len(words['strings'][1])}", "0"),
        (f"internal headers below {SMALL_HEADER} lines", f"{len(small)} of {len(headers)}", "35"),
        ("Makefile targets", f"{len(targets(state.root))}", f"{MOST_TARGETS}"),
        ("pages of the manual", f"{len(manual)}", "40"),
        ("words of the manual", f"{sum(manual.values())}", "38,000"),
        ("words of the notebook", f"{sum(lab.values())}", "40,000"),
        ("words of CHANGELOG.md", f"{len(changelog.split())}", ""),
        ("largest page", f"{manual.get(largest, 0)} ({largest})", f"<= {LONGEST_PAGE}"),
    ]
    return rows


def check(state):
    """Returns a line for each broken rule."""
    program = Program(state)
    faults = [f"{path}: out of format; make format mends it" for path in state.unformatted]
    faults += [
        f"{f.path}:{f.line}: {f.name} has {f.length} lines, more than {LONGEST_FUNCTION}"
        for f in program.functions
        if f.length > LONGEST_FUNCTION
    ]
    faults += [f"{circle[0]}: {program.describe(circle)}" for circle in program.circles()]
    kinds, (_, small) = language(state.root), small_headers(state.root)
    for kind, most in MOST_PHRASES.items():
        if per_thousand(kinds[kind]) > most:
            faults.append(
                f"{kind}: {per_thousand(kinds[kind]):.2f} unidiomatic phrases per 1,000 words, more than {most}; figures.py --list phrases"
            )
    for what, count, most in (
        (
            "unidiomatic phrases in strings; figures.py --list phrases",
            len(kinds["strings"][1]),
            MOST_PHRASES_IN_STRINGS,
        ),
        (f"internal headers below {SMALL_HEADER} lines; figures.py --list headers", len(small), MOST_SMALL_HEADERS),
        ("Makefile targets", len(targets(state.root)), MOST_TARGETS),
    ):
        if count > most:
            faults.append(f"{count} {what}: more than {most}")
    return faults


def extract(commit, root, folder):
    archive = subprocess.run(["git", "archive", commit], cwd=root, capture_output=True)
    if archive.returncode != 0:
        sys.exit(f"figures: {commit}: {archive.stderr.decode().strip()}")
    with tarfile.open(fileobj=io.BytesIO(archive.stdout)) as tar:
        tar.extractall(folder, filter="data") if hasattr(tarfile, "data_filter") else tar.extractall(folder)


def main():
    parser = argparse.ArgumentParser(description="Measures structure, size and language of the code and the manual.")
    parser.add_argument("--reference", metavar="COMMIT", help="count this commit, too")
    parser.add_argument("--root", metavar="FOLDER", help="the present state [default this repository]")
    parser.add_argument(
        "--check", action="store_true", help="print FILE: fault for each exceeded limit; fail if there is one"
    )
    parser.add_argument(
        "--list",
        choices=["once", "long", "circles", "format", "lines", "phrases", "headers"],
        help="list what a figure counts",
    )
    parser.add_argument(
        "--clang-format", metavar="PROGRAM", help=f"clang-format {FORMATTER} [default scripts/.venv/bin/clang-format]"
    )
    parser.add_argument("--program", metavar="PATH", help="its train --help is counted [default build/pags]")
    parser.add_argument(
        "--reference-program", metavar="PATH", help="of the reference [default as make same-bits builds it]"
    )
    options = parser.parse_args()
    root = Path(options.root).resolve() if options.root else root_of_repository()
    formatter = find_formatter(options.clang_format, root)
    with tempfile.TemporaryDirectory(prefix="pags-figures-") as scratch:
        scratch, style = Path(scratch), root / ".clang-format"
        now = State(root, formatter, style, scratch / "now")
        if options.check:
            faults = check(now)
            print(
                "\n".join(
                    faults
                    + [f"figures: {len(faults)} faults" if faults else f"figures: {len(now.code)} files, no fault"]
                )
            )
            return 1 if faults else 0
        if options.list:
            show(now, options.list)
            return 0
        after = figures(now, options.program or root / "build" / "pags")
        if not options.reference:
            for name, value, goal in after:
                print(f"{name:44} {value}")
            return 0
        extract(options.reference, root, scratch / "tree")
        before = State(scratch / "tree", formatter, style, scratch / "before")
        own = (
            scratch / "tree" / ".clang-format"
        )  # a file counts as badly formatted if it differs from the format rules of its own commit
        if own.exists() and own.read_bytes() != style.read_bytes():
            before.unformatted = State(scratch / "tree", formatter, own, scratch / "own").unformatted
        commit = subprocess.run(
            ["git", "rev-parse", options.reference], cwd=root, capture_output=True, text=True
        ).stdout.strip()
        rows = dict(
            (name, value)
            for name, value, _ in figures(
                before, options.reference_program or root / "build/same-bits" / commit[:12] / "build/pags"
            )
        )
        print(f"| figure | {options.reference} | now | goal |\n|---|---|---|---|")
        for name, value, goal in after:
            print(f"| {name} | {rows.get(name, '-')} | {value} | {goal} |")
    return 0


def show(state, what):
    if what == "format":
        print("\n".join(map(str, state.unformatted)))
        return
    if what == "lines":
        for path in walk(state.copy, LINE_FOLDERS):
            print(f"{lines_of(state, path):6} {path}")
        return
    if what == "phrases":
        for kind, (_, found) in language(state.root).items():
            for path, line, phrase, text in found:
                print(f"{path}:{line}: {kind}: {phrase.strip()!r}: {text[:150]}")
        return
    if what == "headers":
        print("\n".join(map(str, small_headers(state.root)[1])))
        return
    program = Program(state)
    if what == "circles":
        for circle in program.circles():
            print(program.describe(circle))
    elif what == "long":
        for f in sorted(program.functions, key=lambda f: -f.length)[:30]:
            print(f"{f.length:5} {f.path}:{f.line} {f.name}")
    else:
        by_file = defaultdict(list)
        for f in program.once():
            by_file[f.path].append(f)
        for path, found in by_file.items():
            print(f"{path}: {len(found)}")
            for f in found:
                print(f"  {f.length:4} {f.name} (line {f.line}), called in {f.callers[0]}")


if __name__ == "__main__":
    sys.exit(main())
