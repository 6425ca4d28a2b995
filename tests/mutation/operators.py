"""Single faults in Python and C++ sources: a change of one operator, number, index or statement."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass

NUMBER = r"(?<![\w.\]])(?:\d+\.\d*(?:e[-+]?\d+)?|\d+e[-+]?\d+|\d+)(?![\w.])"
OPERATORS: dict[str, dict[str, str]] = {
    "comparison": {
        r" < ": " > ", r" > ": " < ", r" <= ": " < ", r" >= ": " > ", r" == ": " != ", r" != ": " == ",
    },
    "sign": {
        r" \+ ": " - ", r" - ": " + ", r" \+= ": " -= ", r" -= ": " += ",
        r"(?<=[\[(=,:?] )-(?=[\w(])|(?<=[\[(])-(?=[\w(])|(?<=return )-(?=[\w(])": "",
    },
    "factor": {r" \* ": " / ", r" / ": " * ", r" \*= ": " /= ", r" /= ": " *= "},
    "constant": {NUMBER: "(2 * {0} + 1)"},
    "bound": {
        r"\bmin(?=imum\(|\()": "max", r"\bmax(?=imum\(|\()": "min",
        r"\bsmaller(?=\()": "larger", r"\blarger(?=\()": "smaller",
    },
    "logic": {
        r" and ": " or ", r" or ": " and ", r" && ": " || ", r" \|\| ": " && ", r"\bnot (?!in\b)|!(?=[\w(])": "",
        r"\bTrue\b": "False", r"\bFalse\b": "True", r"\btrue\b": "false", r"\bfalse\b": "true",
    },
    "index": {
        r"\[0\]": "[1]", r"\[1\]": "[0]", r"\[-1\]": "[0]", r"(?<=\w) \+ 1\]": "]", r"\[1:": "[", r":-1\]": ":]",
    },
}  # fmt: skip
"""Searched pattern and its replacement, by name."""

HIDDEN = {
    "py": r"\"\"\".*?\"\"\"|\"(?:\\.|[^\"\\\n])*\"|'(?:\\.|[^'\\\n])*'|#[^\n]*",
    "cpp": r"/\*.*?\*/|//[^\n]*|\"(?:\\.|[^\"\\\n])*\"|'(?:\\.|[^'\\\n])*'|^#[^\n]*|\btemplate <[^\n]*",
}
"""Strings, comments and preprocessor lines."""

STATEMENT = r"^ +(?:[\w.:>()-]|\[[^\]\n]*\])+(?: (?:[-+*/]?=) [^\n]*|\([^\n]*\));$"
"""A line of C++ with a call or an assignment, without a declaration."""


@dataclass(frozen=True)
class Fault:
    """Change of one place in a file."""

    path: str
    operator: str
    start: int
    stop: int
    new: str

    def put_into(self, text: str) -> str:
        """Return the text with the fault."""
        return text[: self.start] + self.new + text[self.stop :]

    def described(self, text: str) -> str:
        """Line of the fault, before and after."""
        number = text.count("\n", 0, self.start)
        before, after = (lines.splitlines()[number].strip() for lines in (text, self.put_into(text)))
        return f"{self.path}:{number + 1} {self.operator}: {before} -> {after or 'nothing'}"


def faults(path: str, text: str) -> list[Fault]:
    """Every fault of a Python or C++ source; some change nothing (``changes``), some in C++ do not compile."""
    python = path.endswith(".py")
    hidden = HIDDEN["py" if python else "cpp"]
    code = re.sub(hidden, lambda m: re.sub(r"[^\n]", "~", m[0]), text, flags=re.DOTALL | re.MULTILINE)
    found = [
        Fault(path, operator, *match.span(), new.format(match[0]))
        for operator, rules in OPERATORS.items()
        for pattern, new in rules.items()
        for match in re.finditer(pattern, code)
    ]
    if python:
        return [*found, *_dropped(path, text)]
    return [*found, *(Fault(path, "statement", *m.span(), "") for m in re.finditer(STATEMENT, text, re.MULTILINE))]


def changes(fault: Fault, text: str) -> bool:
    """Return true if a faulty source still parses as Python with another meaning; for C++ the compiler decides."""
    return not fault.path.endswith(".py") or _meaning(fault.put_into(text)) not in ("", _meaning(text))


def _dropped(path: str, text: str) -> Iterator[Fault]:
    """Drop calls and assignments, each of one line within a function."""
    starts = [0, *(match.end() for match in re.finditer("\n", text))]
    functions = (node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.FunctionDef))
    nodes = {node for function in functions for node in ast.walk(function) if isinstance(node, ast.stmt)}
    for node in sorted(nodes, key=lambda node: (node.lineno, node.col_offset)):
        call = isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)
        line = text[starts[node.lineno - 1] :].partition("\n")[0]
        whole = node.lineno == node.end_lineno and line.isascii()  # the parser counts bytes
        if whole and (call or isinstance(node, (ast.Assign, ast.AugAssign))):
            begin = starts[node.lineno - 1]
            yield Fault(path, "statement", begin + node.col_offset, begin + (node.end_col_offset or 0), "pass")


def _meaning(text: str) -> str:
    """Syntax tree of a text as a string; "" for invalid Python."""
    try:
        return ast.dump(ast.parse(text))
    except SyntaxError:
        return ""
