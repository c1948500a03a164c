"""Measure the power of the tests: the share of small faults in the sources that a test finds.

A mutant is the package with one operator, sign, constant or comparison of one line replaced. The
lines are chosen by the hash of their text and the seed, so that most choices outlast a change of
the sources. Each mutant is built in a copy of the tree, and the tests run until one fails.

    . tools/env.sh && CC="ccache gcc" CXX="ccache g++" python tools/mutate.py --count 40

A mutant that survives is a missing test, or has the same results as the original: look at it.
"""

from __future__ import annotations

import argparse
import hashlib
import io
import os
import re
import shutil
import subprocess
import sys
import tokenize
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]

PHYSICS = ("test/model", "test/estimation")
CONDITIONING = (
    "test/estimation/test_reading_rules.py test/estimation/test_time_line.py", "test/estimation",
    "test/model",
)  # fmt: skip
SOURCES = {
    "cdrj_ros/core/(cable|cells|friction|guide|law)": PHYSICS,
    "cdrj_ros/core/(report|residual|robot[.]|route|tangents|vectors)": PHYSICS,
    "cdrj_ros/core/(channel|conditioner|lag|motion|step_detector|time_line|units)": CONDITIONING,
    "cdrj_ros/estimation/(conditioner|beliefs|corrections|sensors)": CONDITIONING,
}
"""Beginnings of the files that are mutated, and their tests, likely killers first."""

BUILD = ("setup.py", "-q", "build_ext", "--inplace")
PATIENCE_S = 900.0

OPERATORS = {
    "+": ["-"], "-": ["+"], "*": ["/"], "/": ["*"], "+=": ["-="], "-=": ["+="], "*=": ["/="],
    "<": ["<=", ">="], "<=": ["<", ">"], ">": [">=", "<="], ">=": [">", "<"],
    "==": ["!="], "!=": ["=="], "&&": ["||"], "||": ["&&"], "and": ["or"], "or": ["and"],
}  # fmt: skip
WORDS = {
    "sin": "cos", "cos": "sin", "max": "min", "min": "max", "minimum": "maximum",
    "maximum": "minimum", "true": "false", "false": "true", "True": "False", "False": "True",
}  # fmt: skip
TOKEN = re.compile(
    r"(?<= )(?P<operator>[-+*/<>]|[-+*]=|[<>=!]=|&&|\|\||and|or)(?= )"
    r"|(?P<sign>(?<=[(,=\[] )-(?=[\w(])|(?<=[(\[])-(?=[\w(])|(?<=return )-(?=[\w(]))"
    r"|(?P<number>(?<![\w.])\d+(\.\d*)?(e-?\d+)?(?![\w.]))"
    r"|(?P<word>\b(" + "|".join(WORDS) + r")\b)"
)


class Mutant(NamedTuple):
    """One replacement in one line."""

    file: str
    line: int  # from 0
    column: int
    old: str
    new: str
    text: str  # of the line

    def rank(self, seed):
        """Order of choice, which does not depend on other lines or the name of the file."""
        key = f"{seed} {self.text.strip()} {self.text[: self.column].strip()} {self.new}"
        return hashlib.sha256(key.encode()).hexdigest()


def without_texts(source, suffix):
    """Blank comments, strings and directives; every other character keeps its position."""
    blank = re.compile(r"[^\n]")
    if suffix != ".py":
        texts = r'//[^\n]*|/\*.*?\*/|"(\\.|[^"\\\n])*"|^#[^\n]*'
        return re.sub(texts, lambda m: blank.sub(" ", m[0]), source, flags=re.DOTALL | re.MULTILINE)
    lines = source.splitlines()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type in (tokenize.STRING, tokenize.COMMENT):
            (first, begin), (last, end) = token.start, token.end
            for row in range(first, last + 1):
                text = lines[row - 1]
                a, b = begin if row == first else 0, end if row == last else len(text)
                lines[row - 1] = text[:a] + " " * (b - a) + text[b:]
    return "\n".join(lines)


def replacements(match):
    """List what may stand in place of a token."""
    old, kind = match[0], match.lastgroup
    if match["number"]:
        value = float(old)
        return [str(int(old) + 1)] if old.isdigit() else [repr(1.5 * value or 1.0)]
    if kind == "operator":
        return OPERATORS[old]
    return [""] if match["sign"] else [WORDS[old]]


def mutants(tree):
    """Find all mutants of all sources."""
    for path in sorted(tree.glob("cdrj_ros/**/*.*pp")) + sorted(tree.glob("cdrj_ros/**/*.py")):
        file = str(path.relative_to(tree))
        if not any(re.match(begin, file) for begin in SOURCES):
            continue
        source = path.read_text(encoding="utf-8")
        code = without_texts(source, path.suffix).splitlines()
        for number, (text, line) in enumerate(zip(source.splitlines(), code, strict=True)):
            for match in TOKEN.finditer(line):
                for new in replacements(match):
                    yield Mutant(file, number, match.start(), match[0], new, text)


def chosen(tree, seed, only):
    """Yield mutants in the order of choice, one per line."""
    seen = set()
    for mutant in sorted(mutants(tree), key=lambda one: one.rank(seed)):
        if only in mutant.file and mutant[:2] not in seen:
            seen.add(mutant[:2])
            yield mutant


def copy_tree(to):
    """Copy what git tracks."""
    for name in subprocess.check_output(["git", "ls-files"], cwd=ROOT, text=True).splitlines():
        (to / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, to / name, follow_symlinks=False)


def run(tree, *command):
    """Run Python in the copy; return exit code and output."""
    paths = f"{tree}:{os.environ.get('PYTHONPATH', '')}"
    env = os.environ | {"PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1"}
    ended = subprocess.run(
        [sys.executable, *command], cwd=tree, env=env, timeout=PATIENCE_S, check=False,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    return ended.returncode, ended.stdout.decode()


def killer(tree, tests):
    """The first test that fails, or how the tests end otherwise; "" if they pass."""
    try:
        code, output = run(tree, "-m", "pytest", "-qx", "-p", "no:cacheprovider", *tests.split())
    except subprocess.TimeoutExpired:
        return f"no end within {PATIENCE_S:g} s"
    failed = re.findall(r"^(?:FAILED|ERROR) (\S+)", output, re.MULTILINE)
    if code > 0 and not failed:
        sys.exit(f"the tests cannot be run:\n{output[-2000:]}")
    return failed[0] if failed else "" if code == 0 else f"ended by signal {-code}"


def test(tree, mutant):
    """Return the test that kills a mutant, "" if none does, or None if it cannot be built."""
    path = tree / mutant.file
    source = path.read_text(encoding="utf-8")
    lines = source.split("\n")
    before, after = mutant.text[: mutant.column], mutant.text[mutant.column + len(mutant.old) :]
    lines[mutant.line] = before + mutant.new + after
    tests = next(tests for begin, tests in SOURCES.items() if re.match(begin, mutant.file))
    try:
        path.write_text("\n".join(lines), encoding="utf-8")
        if path.suffix != ".py" and run(tree, *BUILD)[0]:
            return None
        return next(filter(None, (killer(tree, some) for some in tests)), "")
    finally:
        path.write_text(source, encoding="utf-8")
        if path.suffix != ".py":  # the next mutant may not build
            run(tree, *BUILD)


def main():
    """Test mutants one after the other, and print the share that was killed."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=200, help="number of mutants")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="part of the names of the files to mutate")
    parser.add_argument("--folder", type=Path, default=ROOT / "build" / "mutants")
    args = parser.parse_args()

    shutil.rmtree(args.folder, ignore_errors=True)
    tree = args.folder / "cdrj_ros"
    copy_tree(tree)
    if run(tree, *BUILD)[0]:
        sys.exit("the sources cannot be built")
    results = []
    for mutant in chosen(tree, args.seed, args.only):
        if len(results) == args.count:
            break
        if (found := test(tree, mutant)) is None:
            continue
        results.append(bool(found))
        killed = sum(results)
        where = f"{mutant.file}:{mutant.line + 1}:{mutant.column + 1}"
        print(f"{killed}/{len(results)} {where} {mutant.old!r} -> {mutant.new!r}: ", end="")
        print(found or f"SURVIVES {mutant.text.strip()}", flush=True)
    print(f"{killed / len(results):.0%} of {len(results)} mutants killed")


if __name__ == "__main__":
    main()
