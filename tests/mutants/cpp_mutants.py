"""Every fault that can be put into a C++ source, found by its text. What does not compile is drawn again."""

import re

from mutants.mutant import Mutant

FLIPPED = {"<": ">=", "<=": ">", ">": "<=", ">=": "<", "==": "!=", "!=": "=="}
NUMBER = re.compile(r"(?<![\w.<])(\d+\.?\d*(?:e[-+]?\d+)?)(f?)(?![\w.>])")
COMPARED = re.compile(r"(?<=\s)(<=|>=|==|!=|<|>)(?=\s)")
SUM = re.compile(r"(?<=[\w\])] )([+-])(?= [\w(])")
CLAMP = re.compile(r"std::(?:max|min)(?:<\w+>)?\(([^(),]+), [^(),]+\)")
BRANCH = re.compile(r"\bif \((?!constexpr)(.+?)\)(?= |$)")
INDEX = re.compile(r"(?<=\[)(\w+)(?=\])")
ELSEWHERE = re.compile(r"__wasm__|_WIN32|__APPLE__|__clang__|SO_NOSIGPIPE")  # not of GCC on Linux
STATEMENT = re.compile(r"^\s+((?:[\w.\[\]>-]+ [-+*/]?= |[\w.:>-]+\().*;)$")


def code_lines(source: str) -> set[int]:
    """Lines that hold code: no blanks, comments, includes or braces alone."""
    return {n for n, line in enumerate(_blanked(source).splitlines(), 1) if re.search(r"\w", line)}


def mutants(source: str) -> list[Mutant]:
    """All faults of a source."""
    found: list[Mutant] = []
    for n, line in enumerate(_blanked(source).splitlines(), 1):
        for m in NUMBER.finditer(line):
            if float(m[1]) and "case " not in line:
                found += [Mutant(n, *m.span(), f"({m[0]} {by} 2)", f"constant {by} 2") for by in "*/"]
        for m in COMPARED.finditer(line):
            if "template" not in line:
                found.append(Mutant(n, *m.span(), FLIPPED[m[0]], "comparison flipped"))
        for m in SUM.finditer(line):
            found.append(Mutant(n, *m.span(), "-" if m[0] == "+" else "+", "+ and - swapped"))
        for m in CLAMP.finditer(line):
            found.append(Mutant(n, *m.span(), f"({m[1]})", "clamp removed"))
        for m in BRANCH.finditer(line):
            if m[1].count("(") == m[1].count(")"):
                found += [Mutant(n, *m.span(1), forced, "branch forced") for forced in ("true", "false")]
        for m in INDEX.finditer(line):
            found.append(Mutant(n, *m.span(), f"{m[0]} + 1", "index + 1"))
        if m := STATEMENT.match(line):
            found.append(Mutant(n, *m.span(1), ";", "statement deleted"))
            if re.match(r"^ {4}\S", line):
                found.append(Mutant(n, *m.span(1), f"return; {m[1]}", "early return"))
    return found


def _blanked(source: str) -> str:
    """The source with spaces for what is no code of this machine, so that columns stay: comments, strings, preprocessor
    lines, and what stands between those for another machine."""
    kept, conditions = [], []
    for line in source.splitlines(keepends=True):
        if m := re.match(r"[ \t]*#[ \t]*(if\w*|el\w+|endif)\b(.*)", line):
            if m[1].startswith("el"):
                conditions[-1] = False
            elif m[1] == "endif":
                conditions.pop()
            else:
                conditions.append(
                    m[1] != "ifndef" and ELSEWHERE.search(re.sub(r"!\s*defined\(\w+\)", "", m[2])) is not None
                )
        kept.append(re.sub(r"[^\n]", " ", line) if any(conditions) else line)
    dull = re.compile(r'//[^\n]*|/\*.*?\*/|"(?:\\.|[^"\\\n])*"|^[ \t]*#[^\n]*', re.S | re.M)
    return dull.sub(lambda m: re.sub(r"[^\n]", " ", m[0]), "".join(kept))
